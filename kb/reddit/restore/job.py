"""Posts and comments of released folders, as a job of `kb restore`."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import pyarrow as pa
import pyarrow.compute as pc

from kb.artifacts.restore import MISSING, WantedContent
from kb.core.config.profile.collecting import RedditSection
from kb.core.context import Run
from kb.core.summary import Summary
from kb.core.summary.plan import PlanPart, PlanPhase
from kb.reddit.crawl.errors import require
from kb.reddit.plan import plan_rebuild
from kb.reddit.restore.reconstruct import WITHOUT_KEY, rebuild
from kb.store.layout import Layout
from kb.store.tables import parquet


@dataclass(frozen=True)
class ThreadRestore:
    """Restores posts and comments into restored/reddit; `dumps` are read instead of Reddit."""

    run: Run
    content: WantedContent
    dumps: Sequence[Path]

    @property
    def wanted(self) -> bool:
        """Whether a folder of Reddit was chosen."""
        return bool(self.content.of("reddit"))

    def check(self, needed: tuple[str, ...]) -> tuple[str, ...]:
        """As `RestoreJob.check`. Raises ProfileError without [reddit], MissingCredential."""
        if self.wanted:
            self.run.profile.section(RedditSection)
            if not self.dumps:
                require(self.run, *needed, without=WITHOUT_KEY)
        return needed

    def plan(self) -> PlanPart:
        """As `RestoreJob.plan`. Raises SettingError."""
        if not self.wanted:
            return PlanPart()
        key = f"Reddit, {self.run.settings.named('reddit_client_id')}"
        summary = plan_rebuild(self.run, self._folders(), self.dumps)
        phases = [PlanPhase(**one) for one in summary["phases"]]
        whom = "dumps, no key" if self.dumps else key
        return PlanPart([one.of(whom) for one in phases], [str(summary["assumed"])])

    def restore(self) -> Summary:
        """As `RestoreJob.restore`. Raises as `rebuild`."""
        out, removed = Layout(self.run.root).restored("reddit"), self.content.removed("reddit")
        return rebuild(self.run, self._folders(), out, dumps=self.dumps, removed=removed)

    def missing(self) -> pa.Table | None:
        """As `RestoreJob.missing`; the prefix of a full name tells posts from comments."""
        path = Layout(self.run.root).restored("reddit") / MISSING
        if not path.is_file():
            return None
        rows = parquet.read_table(path, columns=["key", "reason"])
        keys, reasons = (rows[name].cast(pa.string()) for name in ("key", "reason"))
        parts = pc.if_else(pc.starts_with(keys, "t3_"), "post", "comment")
        sources = pa.repeat("reddit", rows.num_rows)
        return pa.table({"source": sources, "part": parts, "key": keys, "reason": reasons})

    def _folders(self) -> list[Path]:
        return [one.path for one in self.content.of("reddit")]
