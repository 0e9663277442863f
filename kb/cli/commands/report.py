"""`kb report`: figures and one HTML page."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from kb.cli.framework.command import command, group

if TYPE_CHECKING:
    from kb.core.context import Run
    from kb.core.verdict import Summary

app = group("Figures and one HTML page of what was collected.")


@command(
    app,
    needs_data=True,
    uses=("workers",),
    json="figures, page, without",
    examples=[
        "kb report                                what is there so far; open report/index.html"
    ],
)
def report(
    run: Run,
    out: Annotated[
        Path | None,
        typer.Option(
            "--out",
            metavar="DIR",
            help="Write there. [default: report/ under the data root; for a download the cache]",
        ),
    ] = None,
) -> Summary:
    """Figures (SVG, PNG, PDF) and one page that needs no network, in report/ under the data root.

    Works at any time on what was filtered so far, on a restored root and on a downloaded release;
    a source without data is named in a line.
    """
    from kb.report.build import report

    return report(run, out)
