"""Which stages have a threshold, for which tables."""

from collections.abc import Iterator
from typing import NamedTuple
from urllib.parse import urlencode

from kb.core.config import pipeline
from kb.core.config.profile import Profile
from kb.core.sources import SOURCES
from kb.explore.tables import CurrentTables
from kb.filters.chain import Chain
from kb.filters.thresholds import StageThreshold, thresholds


class StageOfTable(NamedTuple):
    """A stage with a threshold, and the table whose rows it judges. Rows of the tables `followers`
    are kept only with their row of this one.
    """

    source: str
    table: str
    threshold: StageThreshold
    chain: Chain
    followers: tuple[str, ...]

    @property
    def name(self) -> str:
        """How pages call it: "youtube videos: views"."""
        return f"{self.source} {self.table}: {self.threshold.stage}"

    @property
    def view(self) -> str:
        """The bare name of the table."""
        return f"{self.source}_{self.table}"

    @property
    def rejected(self) -> str:
        """The bare name of the table with the rejected rows."""
        return f"{self.source}_rejected"

    @property
    def address(self) -> str:
        """The address of its page."""
        named = {"source": self.source, "table": self.table, "stage": self.threshold.stage}
        return f"/thresholds?{urlencode(named)}"

    @property
    def sign(self) -> str:
        """How a number compares with the limit in a row that passes."""
        return "≥" if self.threshold.at_least else "≤"

    @property
    def group(self) -> str:
        """The column by which changes are counted: the channel of videos, the type of posts."""
        named = [name for name in ("channel_title", "type") if name in self.chain.described_by]
        return named[0] if named else ""


def stages_of(tables: CurrentTables, profile: Profile) -> Iterator[StageOfTable]:
    """The stages of the shipped pipelines whose columns the tables have. Raises DamagedData."""
    for source in SOURCES:
        if getattr(profile, source, None) is None:
            continue
        clean = pipeline.load(str(pipeline.locate(source))).clean(profile)
        following = tuple(one.table.partition("/")[2] for one in clean.chains if one.relate)
        for chain in clean.chains:
            table = chain.table.partition("/")[2]
            if f"{source}_{table}" not in tables:
                continue
            columns = tables.columns(f"{source}_{table}")
            for threshold in thresholds(chain.stages):
                if threshold.reads <= columns:
                    followers = () if chain.relate else following
                    yield StageOfTable(source, table, threshold, chain, followers)
