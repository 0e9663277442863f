"""A user's work on Reddit's sandbox, in this process; `job` runs `kb` as a process of its own."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import pyarrow.parquet as pq
import zstandard

from kb.core.config.pipeline import Recipe
from kb.core.config.profile import load_profile
from kb.core.config.profile.products import Toxicity
from kb.core.config.settings import load_settings
from kb.core.context import Run
from kb.core.summary import Summary
from kb.filters.filter_run import run_clean
from kb.reddit.crawl.connector import crawl
from kb.reddit.crawl.importer import import_dumps
from kb.reddit.crawl.refresh import refresh
from kb.reddit.restore.reconstruct import rebuild
from tests.faults import LoggedRequest, Sandbox
from tests.youtube.job import Job

NOW = "2026-11-20T12:00:00Z"
LATER = "2027-01-20T12:00:00Z"  # more than max_age_days after NOW


class Work:
    """One data root and one sandbox."""

    crawled: Summary
    filtered: Summary
    asked: list[
        LoggedRequest
    ]  # what the crawl asked for: other tests may ask the same sandbox later

    def __init__(
        self, sandbox: Sandbox, place: Path, *, scored: bool = False, **section: Any
    ) -> None:
        """`scored`: by the sandbox's tiny model, else not at all. `section`: values of the
        profile's [reddit] that are not the shipped ones.
        """
        self.scored, self.section = scored, section
        self.sandbox, self.place, self.root = sandbox, place, place / "data"
        self.world = sandbox.world.reddit

    def run(self, **options: Any) -> Run:
        """The run of a command with these common options."""
        values = self.sandbox.settings(model=self.scored)
        settings = load_settings(
            dotenv=False,
            kb_data=self.root,
            **{name.lower(): value for name, value in values.items()},
        )
        profile = load_profile("minecraft")
        reddit = profile.section("reddit").model_copy(update=self.section)
        toxicity = profile.toxicity if self.scored else Toxicity(toxicity="off")
        profile = profile.model_copy(update={"toxicity": toxicity, "reddit": reddit})
        return replace(
            Run(settings=settings, profile=profile, root=self.root, workers=1), **options
        )

    def job(self) -> Job:
        """The same data root for `kb` processes."""
        return Job(self.sandbox, self.place, KB_NOW=NOW)

    def crawl(self, since: Any = None, until: Any = None, **options: Any) -> Summary:
        return crawl(self.run(**options), since, until)

    def take_in(self, files: list[Path]) -> Summary:
        return import_dumps(self.run(), files)

    def filter(self) -> Summary:
        return run_clean(self.run(), "reddit")

    def export(self, layout: str = "parquet") -> Summary:
        return Recipe("reddit").defined("export")(self.run(), "reddit", layout)

    def refresh(self, older_than: int | None = None, **options: Any) -> Summary:
        return refresh(self.run(**options), older_than)

    def rebuild(self, ids: Path | None = None, out: Path | None = None, **options: Any) -> Summary:
        return rebuild(self.run(**options), ids, out or self.place / "out")

    def purge(self, ids: Path | None = None, people: Path | None = None) -> Summary:
        return Recipe("purge").defined("purge")(self.run(), "reddit", ids, people)

    def table(self, *parts: str) -> list[dict[str, Any]]:
        """All rows of a folder of Parquet files below the data root, or of a folder given whole."""
        return rows(self.root.joinpath(*parts))

    def text(self) -> dict[str, str]:
        """What stands in every file of the data root, decompressed, by path."""
        return texts(self.root)


def rows(folder: Path, pattern: str = "*.parquet") -> list[dict[str, Any]]:
    """All rows of a folder of Parquet files."""
    return [row for path in sorted(folder.glob(pattern)) for row in pq.read_table(path).to_pylist()]


def texts(folder: Path) -> dict[str, str]:
    """What stands in every file, decompressed, by path."""
    return {
        str(path.relative_to(folder)): _text(path)
        for path in sorted(folder.rglob("*"))
        if path.is_file()
    }


def _text(path: Path) -> str:
    if path.suffix == ".parquet":
        return json.dumps(pq.read_table(path).to_pylist(), default=str, ensure_ascii=False)
    if ".zst" in path.name:
        with path.open("rb") as file:
            return (
                zstandard.ZstdDecompressor()
                .stream_reader(file, read_across_frames=True)
                .read()
                .decode()
            )
    return path.read_bytes().decode("utf-8", "replace")
