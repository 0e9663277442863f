"""`kb report`: figures and one HTML page."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from kb.cli.framework.command import command, group
from kb.core.context import Run
from kb.core.summary import Summary

app = group("Make figures and one HTML page about the collected data.")


@command(
    app,
    needs_data=True,
    uses=("workers",),
    json="figures, page, without",
    examples=["kb report                                then open report/index.html"],
)
def report(
    run: Run,
    out: Annotated[
        Path | None,
        typer.Option(
            "--out",
            metavar="DIR",
            help="Write there. [default: report/ in the data root; the cache for a download]",
        ),
    ] = None,
) -> Summary:
    """Make figures (SVG, PNG, PDF) and one page that needs no network, in report/ of the data root.

    Works at any time on what has been filtered so far, on a restored data root and on a downloaded
    release. The page names sources without data.
    """
    from kb.report.build import report

    return report(run, out)
