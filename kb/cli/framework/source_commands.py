"""The commands that every source has: `filter`, `export`, and a plain `crawl` for a source without
commands of its own.
"""

from __future__ import annotations

from collections.abc import Callable
from enum import StrEnum
from typing import TYPE_CHECKING, Annotated, Any

import typer

from kb.cli.framework.command import command, group
from kb.cli.framework.options import CLUSTER, pipeline
from kb.core.sources import SOURCES
from kb.core.summary import Summary

if TYPE_CHECKING:
    from kb.core.context import Run


def add_filter(app: typer.Typer, source: str, what: str = "raw answers") -> Callable[..., Summary]:
    """`kb <source> filter`, which sorts `what`."""

    def filter_(run: Run) -> Summary:
        from kb.filters.filter_run import check_kept, run_clean

        summary = run_clean(run, source)
        check_kept(run, source, summary)
        return summary

    filter_.__doc__ = (
        f"Sort {what} into clean/{source}: kept, rejected (with the reason), failed and pending."
    )
    return command(
        app,
        name="filter",
        uses=(*CLUSTER, "pipeline"),
        limit="Stop after scoring N more texts for toxicity (exit code 3); the next run resumes.",
        json="crawled, kept, rejected, failed, pending, missing, stages, tables",
        needs_data=True,
        checks=True,
        examples=[f"kb {source} filter", f"kb {source} filter --profile mine.toml"],
    )(filter_)


def add_export(
    app: typer.Typer,
    source: str,
    *,
    goes: str = "Parquet goes",
    tables: str = "the released tables",
) -> Callable[..., Summary]:
    """`kb <source> export`, as Parquet and in its other formats."""
    others = SOURCES[source].formats
    formats = StrEnum("Format", ["parquet", *others])  # type: ignore[misc]
    parquet = formats("parquet")

    def export(run: Run, format: Any = parquet) -> Summary:
        from kb.artifacts import domain_binding
        from kb.export import layouts

        with domain_binding.writing(run, f"release-{source}"):
            own = getattr(pipeline(run, source), "export", None)
            if own is None:
                return layouts.export(run, source, format.value)
            summary: Summary = own(run, format.value)
            return summary

    option = typer.Option("--format", help=f"{goes} to release/, other formats to export/FORMAT/.")
    export.__annotations__["format"] = Annotated[formats, option]
    export.__doc__ = f"Write clean/{source} as {tables}, or in another layout."
    return command(
        app,
        uses=("engine", "scheduler", "pipeline"),
        json="the rows of each table, and path",
        needs_data=True,
        examples=[
            f"kb {source} export",
            *(f"kb {source} export --format {name}" for name in others[-1:]),
        ],
    )(export)


def app_of(name: str) -> typer.Typer:
    """The commands of a source that declares none: crawl, filter and export."""
    source = SOURCES[name]
    app = group(source.help)

    def crawl(run: Run) -> Summary:
        from kb.crawl.job import crawl_source

        return crawl_source(run, source)

    crawl.__doc__ = f"Crawl what is left: {', '.join(source.nouns.values())}, as raw answers."
    command(
        app,
        uses=("workers", "wait"),
        limit=f"Stop after N more {source.counted} (exit code 3); the next run resumes.",
        json="crawled, failed, pending, requests",
        checks=True,
        examples=[f"kb {name} crawl", f"kb {name} crawl --limit 100"],
    )(crawl)
    add_filter(app, name)
    add_export(app, name)
    return app
