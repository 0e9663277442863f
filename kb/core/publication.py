"""What is published: the release folder of a source, or of what is made from sources.

The same class says what `kb report` shows. As in kb.core.source, methods import what they need when
they are called.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from typing import TYPE_CHECKING, ClassVar

from kb.core.source_spec import ReleaseSpec

if TYPE_CHECKING:
    from kb.report.figures import FigureMaker


class Publication:
    """One release folder and its section in the report, to inherit from."""

    name: ClassVar[str]
    """The folder release/<name>."""

    title: ClassVar[str]
    """The heading in the report."""

    shown: ClassVar[tuple[str, ...]] = ()
    """Tables with a card in the report, which has no section without any."""

    hint: ClassVar[str] = ""
    """What to run while there is no data to show."""

    sampled: ClassVar[Mapping[str, tuple[str, ...]]] = {}
    """Columns of the sample rows, by table."""

    release: ClassVar[ReleaseSpec]

    def figures(self) -> Sequence[FigureMaker]:
        """What the report draws; by default what each filter stage leaves over."""
        from kb.report.figures import funnel

        return [partial(funnel, name=name) for name in self.shown]


class Pairs(Publication):
    """Video-text pairs."""

    name = "pairs"
    title = "Video-text pairs"
    shown = ("pairs/pairs",)
    hint = "run `kb pairs` after `kb youtube filter`"
    sampled = {
        "pairs/pairs": (
            *("keyword", "keyword_kind", "text", "token_count", "clip_start_s", "clip_end_s"),
            "video_id",
        )
    }
    release = ReleaseSpec(
        main="pairs",
        query="SELECT keyword, count(*) AS clips FROM pairs GROUP BY ALL ORDER BY clips DESC"
        " LIMIT 10",
        rules=(
            *("include", "exclude", "near_words", "min_tokens", "max_tokens", "center"),
            *("min_clip_s", "max_clip_s", "min_gap_s", "max_pairs_per_video"),
        ),
        pictured="keyword",
        quality="kb.release.metadata.pair_quality:pair_quality",
        extra="pairs",
    )

    def figures(self) -> Sequence[FigureMaker]:
        from kb.report.pairs import keywords, lengths, quality

        return keywords, lengths, quality


class Tasks(Publication):
    """Candidates for creative tasks."""

    name = "tasks"
    title = "Tasks"
    shown = ("tasks/tasks", "tasks/titles")
    hint = "run `kb tasks` after `kb youtube filter`"
    sampled = {"tasks/tasks": ("prompt", "start_s", "end_s", "start_source", "video_id")}
    release = ReleaseSpec(
        main="tasks",
        query="SELECT prompt, start_s, end_s FROM tasks WHERE start_source <> 'none'"
        " ORDER BY prompt, video_id LIMIT 10",
        rules=("verbs", "lead_ins", "talk", "never", "max_words", "max_gap_s"),
        pictured="start_source",
        quality="kb.release.metadata.judgements:task_quality",
    )

    def figures(self) -> Sequence[FigureMaker]:
        from kb.report.tasks import titles

        return (titles,)


class Links(Publication):
    """Entities and where the sources name them."""

    name = "links"
    title = "Entities"
    shown = ("links/entities", "links/links")
    hint = "run `kb links` after the filters"
    release = ReleaseSpec(
        main="links",
        query="SELECT entity, source, sum(count) AS mentions FROM links GROUP BY ALL"
        " ORDER BY mentions DESC LIMIT 10",
        section="pairs",
        rules=("include", "exclude", "near_words"),
        pictured="entity",
        scraped=True,
    )

    def figures(self) -> Sequence[FigureMaker]:
        from kb.report.links import known, least, most

        return most, least, known


class OpenText(Publication):
    """Transcripts under an open licence."""

    name = "open-text"
    title = "Open text"
    release = ReleaseSpec(
        main="open_text",
        query="SELECT language, count(*) AS videos, sum(word_count) AS words FROM open_text"
        " GROUP BY ALL ORDER BY words DESC",
        licence="CC-BY-3.0",
        scraped=True,
        part_of="youtube",
    )
