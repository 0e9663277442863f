"""`kb label`: people judge a sample in Label Studio."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import Annotated, Any

import typer

from kb.cli.framework.command import command, group
from kb.cli.framework.messages import show_row
from kb.cli.framework.options import Aligned, OnlyPairs
from kb.core.context import Run
from kb.core.errors import SettingError
from kb.core.summary import Summary, interval_text

app = group("Let people judge a sample in Label Studio.")


class JudgedKind(StrEnum):
    """What can be judged."""

    pairs = "pairs"
    tasks = "tasks"


@command(
    app,
    json="items, strata, out_of, hours, path",
    data="reads",
    examples=[
        "kb label export pairs                        400 pairs, to label-pairs/",
        "kb label export pairs --sample 50 --seed 1 --out trial   50 other pairs, to trial/",
        "kb label export pairs --aligned              pairs at the times of `kb pairs align`",
        "kb label export tasks --sample 100           100 tasks, to label-tasks/",
    ],
)
def export(
    run: Run,
    what: Annotated[JudgedKind, typer.Argument(help="What to judge.")],
    sample: Annotated[
        int, typer.Option("--sample", min=1, metavar="N", help="Judge at most N of them.")
    ] = 400,
    seed: Annotated[
        int, typer.Option("--seed", min=0, metavar="N", help="Another seed draws another sample.")
    ] = 0,
    pairs: OnlyPairs = None,
    aligned: Aligned = False,
    out: Annotated[
        Path | None,
        typer.Option("--out", metavar="DIR", help="Write there. [default: label-WHAT]"),
    ] = None,
) -> Summary:
    """Write a sample as a project for Label Studio: config.xml, tasks.json and README.md.

    The sample is stratified (pairs by kind of keyword and timing, tasks by start_source), and each
    item carries the weight that it stands for. A larger sample of the same seed begins with the
    smaller one. Only reads. --data may be a data root or a downloaded release; a release of pairs
    holds no texts, so that the question about the text is left out. With --aligned one question
    is asked, whether the clip shows the keyword at the times that `kb pairs align` found.
    """
    from kb.labels import questions
    from kb.labels.export import export

    if pairs is not None and what is not JudgedKind.pairs:
        raise SettingError("--pairs names pairs, and these are tasks", hint="leave it out")
    if aligned and what is not JudgedKind.pairs:
        raise SettingError("--aligned is of clips of pairs, and these are tasks")
    labeling = {JudgedKind.pairs: questions.PAIRS, JudgedKind.tasks: questions.TASKS}[what]
    place = out or Path(f"label-{what}")
    return export(run, labeling, sample, seed, place, pairs, aligned=aligned)


@command(
    app,
    "import",
    json="answers, added, labels, skipped, no_result, no_annotations, undefined, contradictory,"
    " purged_items, unknown_items, figures",
    resumable=False,
    examples=[
        "kb label import project-1.json               one project, of one person or several",
        "kb label import *.json                       several exports, also overlapping ones",
    ],
)
def import_(
    run: Run,
    files: Annotated[
        list[Path], typer.Argument(metavar="FILE", help="Label Studio's exports, as JSON.")
    ],
) -> Summary:
    """Read Label Studio's exports into labels/, and print what they say of all pairs.

    All files are read before anything is written. Of several answers of one person to the same
    question the newest counts. Answers about items that were purged, or that no table has any
    more, are refused. pairs/measures.json gets the figures, and the cards of pairs and tasks show
    them. People are numbers in the tables.

    Columns: kind of item; question; judged items; share of yes among all items (each judged one
    weighted by what it stands for), or of times within 10 s, with its 95 % interval; Cohen's kappa
    of two people, Fleiss' of more, with the number of items that both or several judged.
    """
    from kb.labels.imports import import_exports

    summary = import_exports(run, files)
    show_row(("kind", "question", "n", "yes", "kappa"))
    for kind, section in summary["figures"].items():
        for name, asked in section["questions"].items():
            shown = asked.get("n", asked["answers"])
            show_row((kind, name, shown, interval_text(asked), _kappa(asked.get("agreement"))))
    return summary


def _kappa(agreement: dict[str, Any] | None) -> str:
    if agreement is None or agreement["kappa"] is None:
        return "-"
    return "{kappa:.2f} ({method}, {items} items)".format_map(agreement)
