"""What is published: the release folder of a source, or of what is made from sources.

The same class says what `kb report` shows. As in kb.core.source, methods import what they need when
they are called.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar, NamedTuple

if TYPE_CHECKING:
    from duckdb import DuckDBPyConnection

    from kb.artifacts.release_folder import ReleaseFolder
    from kb.core.config.profile import Profile
    from kb.export.layouts import Writer
    from kb.report.figures import FigureMaker


class RecordedWay(NamedTuple):
    """Where a data root records that rows came by some way: by the value of a column, by raw
    answers of a kind, or by both, where some answers give no row.

    `ages`: the service's terms limit how old such rows may be. `absent`: the way of those without
    raw answers of the kind.
    """

    column: str = ""
    value: str = ""
    ages: bool = False
    raw: str = ""
    absent: bool = False


class Publication:
    """One release folder and its section in the report, to inherit from."""

    name: ClassVar[str]
    """The folder release/<name>."""

    title: ClassVar[str]
    """The heading in the report."""

    shown: ClassVar[tuple[str, ...]] = ()
    """Tables with rows for the report, which has no section without any."""

    totals: ClassVar[tuple[tuple[str, str, str], ...]] = ()
    """What the report's top counts: (what, table, SQL over its rows); the rows of each table that
    is shown where there are none."""

    hint: ClassVar[str] = ""
    """What to run while there is no data to show."""

    sampled: ClassVar[Mapping[str, tuple[str, ...]]] = {}
    """Columns of the sample rows, by table."""

    main: ClassVar[str]
    """The table that a reader means who names none."""

    query: ClassVar[str]
    """The first query on the card."""

    stages: ClassVar[tuple[str, ...]] = ()
    """The stages of the filters, in order, which the card pictures."""

    pictured: ClassVar[str] = ""
    """The column whose frequent values the card pictures where there are no stages."""

    rules: ClassVar[tuple[str, ...]] = ()
    """Keys of the profile that decide which rows are released."""

    ids_only: ClassVar[bool] = False
    """Whether text columns hold ids and short names only."""

    archives: ClassVar[tuple[str, ...]] = ()
    """Kinds of tar archives beside the tables."""

    paths: ClassVar[tuple[tuple[str, str], ...]] = ()
    """(table, column) pairs that name a file in an archive."""

    licensed: ClassVar[tuple[str, ...]] = ()
    """Tables whose rows name a licence of their own."""

    licence: ClassVar[str] = "CC-BY-4.0"
    """SPDX id when the profile gives none."""

    ways: ClassVar[Mapping[str, RecordedWay]] = {}
    """How rows may have come, by the names that about.toml has sentences for."""

    extra: ClassVar[str] = ""
    """The package extra that the card's commands need."""

    part_of: ClassVar[str] = ""
    """The source whose filter and export also make this folder, of licensed texts."""

    exports: ClassVar[tuple[str, ...]] = ()
    """Files and folders that formats besides Parquet write below export/."""

    @property
    def aging(self) -> list[tuple[str, str]]:
        """Columns with the values of rows whose age the service's terms limit."""
        return [(way.column, way.value) for way in self.ways.values() if way.ages]

    @property
    def formats(self) -> list[str]:
        """The export formats besides Parquet."""
        return list(dict.fromkeys(place.partition("/")[0] for place in self.exports))

    def writers(self) -> Mapping[str, Writer]:
        """The writers of the export formats, and of Parquet where tables are not all of it."""
        return {}

    def gaps(self, con: DuckDBPyConnection, root: Path, folder: ReleaseFolder) -> Iterator[str]:
        """What the released rows lack, measured on them and on the clean ones: sentences for card
        and datasheet.
        """
        return iter(())

    def quality(
        self, con: DuckDBPyConnection, root: Path, folder: ReleaseFolder
    ) -> tuple[str, ...]:
        """How good the released rows are, with figures: sentences for card and datasheet."""
        return ()

    def origin(self, profile: Profile) -> str:
        """The address of the service."""
        return ""

    def figures(self) -> Sequence[FigureMaker]:
        """What the report draws; by default what each filter stage leaves over."""
        from kb.report.figures import funnel

        return [partial(funnel, name=name) for name in self.shown]


class Pairs(Publication):
    """Video-text pairs."""

    name = "pairs"
    title = "Video-text pairs"
    shown = ("pairs/pairs",)
    totals = (("video-text pairs", "pairs/pairs", "count(*)"),)
    hint = "run `kb pairs` after `kb youtube filter`"
    sampled = {
        "pairs/pairs": (
            *("keyword", "keyword_kind", "text", "token_count", "clip_start_s", "clip_end_s"),
            "video_id",
        )
    }
    main = "pairs"
    query = "SELECT keyword, count(*) AS clips FROM pairs GROUP BY ALL ORDER BY clips DESC LIMIT 10"
    pictured = "keyword"
    rules = (
        "pairs.include",
        "pairs.exclude",
        "pairs.near_words",
        "pairs.min_tokens",
        "pairs.max_tokens",
        "pairs.center",
        "pairs.min_clip_s",
        "pairs.max_clip_s",
        "pairs.min_gap_s",
        "pairs.max_pairs_per_video",
    )
    extra = "pairs"

    exports = ("video2dataset", "minedojo/pairs.json")

    def writers(self) -> Mapping[str, Writer]:
        from kb.export import minedojo, pair_layouts

        return {"minedojo": minedojo.pairs, "video2dataset": pair_layouts.video2dataset}

    def quality(
        self, con: DuckDBPyConnection, root: Path, folder: ReleaseFolder
    ) -> tuple[str, ...]:
        from kb.release.metadata.quality import pair_quality

        return pair_quality(con, root, folder)

    def figures(self) -> Sequence[FigureMaker]:
        from kb.report.derived import keywords, lengths, quality

        return keywords, lengths, quality


class Tasks(Publication):
    """Candidates for creative tasks."""

    name = "tasks"
    title = "Tasks"
    shown = ("tasks/tasks", "tasks/titles")
    totals = (("tasks", "tasks/tasks", "count(*)"),)
    hint = "run `kb tasks` after `kb youtube filter`"
    sampled = {"tasks/tasks": ("prompt", "start_s", "end_s", "start_source", "video_id")}
    main = "tasks"
    query = (
        "SELECT prompt, start_s, end_s FROM tasks WHERE start_s IS NOT NULL"
        " ORDER BY prompt, video_id LIMIT 10"
    )
    pictured = "start_source"
    rules = (
        "tasks.verbs",
        "tasks.lead_ins",
        "tasks.talk",
        "tasks.never",
        "tasks.things",
        "tasks.max_words",
        "tasks.max_gap_s",
    )

    exports = ("minedojo/creative_tasks.yaml",)

    def writers(self) -> Mapping[str, Writer]:
        from kb.export import minedojo

        return {"minedojo": minedojo.tasks}

    def quality(
        self, con: DuckDBPyConnection, root: Path, folder: ReleaseFolder
    ) -> tuple[str, ...]:
        from kb.release.metadata.quality import task_quality

        return task_quality(con, root, folder)

    def figures(self) -> Sequence[FigureMaker]:
        from kb.report.derived import titles

        return (titles,)


class Links(Publication):
    """Entities and where the sources name them."""

    name = "links"
    title = "Entities"
    shown = ("links/entities", "links/links")
    totals = (
        ("entities", "links/entities", "count(*)"),
        ("mentions", "links/links", "sum(count)"),
    )
    sampled = {"links/entities": ("entity", "kind")}
    hint = "run `kb links` after the filters"
    main = "links"
    query = (
        "SELECT entity, source, sum(count) AS mentions FROM links GROUP BY ALL"
        " ORDER BY mentions DESC LIMIT 10"
    )
    pictured = "entity"
    rules = (
        "pairs.include",
        "pairs.exclude",
        "pairs.near_words",
    )

    def figures(self) -> Sequence[FigureMaker]:
        from kb.report.derived import known, named

        return named, known


class OpenText(Publication):
    """Transcripts under an open licence."""

    name = "open-text"
    title = "Open text"
    main = "open_text"
    query = (
        "SELECT language, count(*) AS videos, sum(word_count) AS words FROM open_text"
        " GROUP BY ALL ORDER BY words DESC"
    )
    licence = "CC-BY-3.0"
    part_of = "youtube"

    def writers(self) -> Mapping[str, Writer]:
        from kb.export import open_text

        return {"parquet": open_text.export}
