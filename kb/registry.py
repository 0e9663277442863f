"""The classes of the sources and of what is made from them, by name.

Only commands and recipes import this; they hand what they look up to the rooms below.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar

from kb.core.config.settings import DECLARED
from kb.core.errors import SettingError
from kb.core.sources import INSTALLED
from kb.reddit.source import Reddit
from kb.schema.declared import package_problems, problems
from kb.source import Published, Source
from kb.wiki.source import Wiki
from kb.youtube.source import YouTube

if TYPE_CHECKING:
    from duckdb import DuckDBPyConnection

    from kb.artifacts.card_answers import CardAnswer
    from kb.artifacts.release_folder import ReleaseFolder
    from kb.export.layouts import Writer
    from kb.report.figures import FigureMaker


class Pairs(Published):
    """Video-text pairs."""

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


class Draw(Published):
    """Pairs that were drawn."""

    questions: ClassVar[dict[str, str]] = {
        "How many pairs of each keyword are in which split?": "SELECT keyword,"
        " count(*) FILTER (split = 'train') AS train,"
        " count(*) FILTER (split = 'validation') AS validation,"
        " count(*) FILTER (split = 'test') AS test"
        " FROM draw GROUP BY ALL ORDER BY count(*) DESC, keyword",
    }

    def quality(
        self, con: DuckDBPyConnection, root: Path, folder: ReleaseFolder
    ) -> tuple[str, ...]:
        from kb.release.metadata.quality import draw_quality

        return draw_quality(root, folder)

    def answers(
        self, con: DuckDBPyConnection, root: Path, folder: ReleaseFolder
    ) -> Sequence[CardAnswer]:
        from kb.artifacts.card_answers import ask

        return [*ask(con, self.questions, [folder])]


class Tasks(Published):
    """Candidates for creative tasks."""

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


class Links(Published):
    """Entities and where the sources name them."""

    def figures(self) -> Sequence[FigureMaker]:
        from kb.report.derived import known, named

        return named, known


class OpenText(Published):
    """Transcripts under an open licence."""

    def writers(self) -> Mapping[str, Writer]:
        from kb.export import open_text

        return {"parquet": open_text.export}


def _installed() -> Iterator[Source]:
    """The sources of installed packages. Raises SettingError for one that can't be loaded."""
    for name, package in INSTALLED.items():
        try:
            source = package.entry_point.load()(name)
        except Exception as error:
            raise SettingError(
                f"the source {name!r} can't be loaded: {type(error).__name__}: {error}",
                hint=f"correct or uninstall the package in {package.folder}",
            ) from error
        if not isinstance(source, Source):
            raise SettingError(
                f"the source {name!r} is no kb.source.Source",
                hint=f"name its class in the entry point of the package in {package.folder}",
            )
        wrong = list(problems(source.declared, DECLARED.model_fields))
        if wrong := wrong or list(package_problems(source.declared)):
            raise SettingError(
                f"{package.folder / 'schemas'}: {'; '.join(wrong)}",
                hint="correct the files, or uninstall the package",
            )
        yield source


SOURCES: dict[str, Source] = {
    source.name: source
    for source in (YouTube("youtube"), Wiki("wiki"), Reddit("reddit"), *_installed())
}
PUBLISHED: dict[str, Published] = {
    **SOURCES,
    **{
        published.name: published
        for published in (
            *(Pairs("pairs"), Tasks("tasks"), Links("links"), OpenText("open-text")),
            Draw("draw"),
        )
    },
}
