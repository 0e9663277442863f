"""The commands of a source that declares none of its own: crawl, filter and export."""

from __future__ import annotations

from typing import TYPE_CHECKING

import typer

from kb.cli.framework.command import command, group
from kb.cli.framework.source_commands import add_export, add_filter
from kb.core.sources import SPECS

if TYPE_CHECKING:
    from kb.core.context import Run
    from kb.core.summary import Summary


def app_of(name: str) -> typer.Typer:
    """The commands of a source."""
    spec = SPECS[name]
    app = group(spec.help)

    def crawl(run: Run) -> Summary:
        from kb.crawl.job import crawl_source

        return crawl_source(run, spec)

    crawl.__doc__ = f"Crawl what is left: {', '.join(spec.nouns.values())}, as raw answers."
    command(
        app,
        uses=("workers", "wait"),
        limit=f"Stop after N more {spec.counted} (exit code 3); the next run resumes.",
        json="crawled, failed, pending, requests",
        checks=True,
        examples=[f"kb {name} crawl", f"kb {name} crawl --limit 100"],
    )(crawl)
    add_filter(app, name)
    add_export(app, name)
    return app
