"""`kb explore`: web pages over the data, on this machine."""

from __future__ import annotations

from typing import Annotated

import typer

from kb.cli.framework.command import command, group
from kb.cli.framework.messages import warn
from kb.core.context import Run

app = group("Search, rows, stages and pairs in a browser, on this machine.")


@command(
    app,
    without=("json",),
    needs_data=True,
    resumable=False,
    examples=[
        "kb explore                                 opens the pages in your browser",
        "kb explore --data downloaded --port 8080 --no-browser",
    ],
)
def explore(
    run: Run,
    port: Annotated[
        int, typer.Option("--port", min=0, max=65_535, metavar="N", help="0: a free port.")
    ] = 0,
    no_browser: Annotated[
        bool, typer.Option("--no-browser", help="Print the address only.")
    ] = False,
) -> None:
    """Serve web pages over a data root or a downloaded release, until Ctrl-C.

    Pages: search with what surrounds an answer, the funnel of each source, its kept and rejected
    rows with the stage and value that decided, what another threshold would keep, and the pairs of
    a keyword. An index that is missing or out of date is built at the start, in the user's cache
    where the data root can't be written; nothing else is. Prints the address on stdout. Listens on
    127.0.0.1 only, and asks no service; links to videos, threads and pages open when you follow
    them. Needs the extra `explore`.
    """
    from kb.artifacts.table_catalog import read
    from kb.cli.commands.status.command import lines
    from kb.cli.commands.status.overview import overview
    from kb.explore.server import serve

    serve(
        read(run.root).path,
        run.profile,
        lambda: lines(overview(run)),
        port,
        browser=not no_browser,
        say=lambda address: print(address, flush=True),
        first=lambda: _build_index(run),
    )


def _build_index(run: Run) -> None:
    from kb.core.errors import Interrupted, KbError
    from kb.core.sources import SOURCES
    from kb.search.build import ensure

    try:
        ensure(run, list(SOURCES))
    except Interrupted:
        raise
    except KbError as error:  # the other pages need none
        warn(f"no index for Search: {error}; {error.hint}")
