"""What is made of clean tables: `kb tasks`, `kb links`, `kb report`, `kb annotate`, `kb models`.
People judge it with `kb label`, in Label Studio or in the terminal.
"""

from __future__ import annotations

import sys
from enum import StrEnum
from pathlib import Path
from typing import Annotated, Any

import typer

from kb.cli.framework.command import command, group
from kb.cli.framework.messages import show, show_row, warn_stale
from kb.cli.framework.options import CLUSTER, Device, DeviceOption, OnlyPairs, pipeline
from kb.core.context import Run
from kb.core.errors import KbError, SettingError
from kb.core.sources import SOURCES
from kb.core.summary import Summary, interval_text

tasks_app = group("Mine candidates for creative tasks from titles of videos.")


class TasksFormat(StrEnum):
    """Layouts of tasks."""

    parquet = "parquet"
    minedojo = "minedojo"


@command(
    tasks_app,
    uses=("pipeline",),
    again="Mine all titles again, even if nothing has changed.",
    json="tasks, titles, judged, reworded, starts, rejected_by",
    needs_data=True,
    checks=True,
    examples=[
        "kb tasks                                 prompts with times, in tasks/ and release/tasks/",
        "kb tasks --format minedojo               export/minedojo/creative_tasks.yaml",
        'kb query "FROM tasks_titles SELECT rejected_reason, count(*) GROUP BY ALL"',
    ],
)
def tasks(
    run: Run,
    format: Annotated[
        TasksFormat,
        typer.Option("--format", help="Parquet goes to release/, other formats to export/FORMAT/."),
    ] = TasksFormat.parquet,
) -> Summary:
    """Mine tasks from titles: "How to Build an EASY Iron Farm!" is "build an easy iron farm".

    Each video gives at most one task, which begins where a chapter or the transcript first names
    its object. Every title that gives none is in tasks_titles with the reason. The verbs and
    phrases are those of [tasks] in the profile. What people judged (`kb label`) counts: tasks that
    they rejected are left out, their wordings and times replace those of the title.
    """
    summary: Summary = pipeline(run, "tasks").tasks(run, format.value)
    return summary


links_app = group("Find which videos, wiki pages and threads mention which entities.")


@command(
    links_app,
    uses=(*CLUSTER, "pipeline"),
    again="Match every source again, even if its clean tables have not changed.",
    json="entities, with_page, links, mentions, sources",
    needs_data=True,
    checks=True,
    examples=[
        "kb links                                 what has changed since the last run",
        "kb links --again                         everything again",
        "kb query \"FROM links.links WHERE entity = 'Wolf' ORDER BY count DESC LIMIT 10\"",
    ],
)
def links(run: Run) -> Summary:
    """Make the entity tables: every keyword, its wiki page, and where it is mentioned.

    Videos, pages, posts and comments are matched by the same rules as pairs. links/ and
    release/links/ hold ids, counts and seconds, but no text. A source whose clean files have not
    changed is skipped.
    """
    summary: Summary = pipeline(run, "links").links(run)
    return summary


report_app = group("Make figures and one HTML page about the collected data.")


@command(
    report_app,
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

    warn_stale(run)
    return report(run, out)


annotate_app = group("Score text for toxicity. `filter` does this as well.")
models_app = group("Download the models for toxicity and for scores of pairs.")


class Precision(StrEnum):
    """Precision of the model's numbers."""

    fp32 = "fp32"
    bf16 = "bf16"
    int8 = "int8"


PrecisionOption = Annotated[
    Precision | None,
    typer.Option(
        "--precision",
        help="bf16 and int8 are faster; scores near the threshold are computed again in fp32, and"
        " the precision is recorded with each score. Existing scores of a lower precision than"
        " this are computed again. [default: fp32 for new scores]",
    ),
]


def _add(source: str, about: str, *examples: str) -> None:
    @command(
        annotate_app,
        source,
        help=about,
        uses=(*CLUSTER, "pipeline"),
        limit="Stop after scoring N more texts (exit code 3); the next run resumes.",
        json="texts, scored, known, exact_again, model, revision, precisions",
        examples=examples,
    )
    def annotate(
        run: Run, precision: PrecisionOption = None, device: DeviceOption = Device.auto
    ) -> Summary:
        from kb.annotate.toxicity import ToxicityScorer
        from kb.artifacts import domain_binding
        from kb.filters.filter_run import texts

        run.profile.section(source)  # raises where the profile leaves the source out
        name = f"annotate {source}"
        scorer = ToxicityScorer.open(run, source, precision and str(precision), str(device))
        checkpoint, scores = scorer.checkpoint, scorer.scores
        if checkpoint is None or scores is None:
            return Summary(command=name, source=source, scored=0, toxicity="off in the profile")
        try:
            with domain_binding.writing(run, source):
                counts = scorer.annotate(texts(run, source))
        except KbError as error:
            error.summary = Summary(command=name, source=source, precisions=scores.precisions())
            raise
        return Summary(
            command=name,
            source=source,
            texts=counts.texts,
            scored=counts.scored,
            known=counts.known,
            exact_again=counts.exact_again,
            model=checkpoint.model,
            revision=checkpoint.revision,
            precisions=scores.precisions(),
        )


for _name, _source in SOURCES.items():
    _examples = _source.annotate_examples or (f"kb annotate {_name}",)
    _add(_name, _source.annotate_help, *_examples)


@command(
    models_app,
    without=("data",),
    json="model, fetched, present, bytes, folder",
    examples=[
        "kb models fetch                the model of the paper, Detoxify `original`",
        "kb models fetch unbiased       another model; then set KB_TOXICITY_MODEL=unbiased",
        "kb models fetch clip           the profile's CLIP model, for `kb pairs score`",
    ],
)
def fetch(
    run: Run,
    name: Annotated[
        str,
        typer.Argument(
            metavar="[NAME]",
            help="original, unbiased, multilingual, original-small, unbiased-small or clip.",
        ),
    ] = "original",
) -> Summary:
    """Download a published checkpoint with its configuration and vocabulary, and verify them.

    An interrupted download resumes. The files are kept in the user's cache, for all data roots.
    """
    if name == "clip":
        from kb.score.models import fetch as fetch_clip

        return fetch_clip(run)
    from kb.annotate.fetch import fetch as room

    return room(run, name)


label_app = group("Let people judge a sample in Label Studio, or tasks in the terminal.")


class JudgedKind(StrEnum):
    """What can be judged."""

    pairs = "pairs"
    tasks = "tasks"


@command(
    label_app,
    json="items, strata, out_of, hours, path",
    needs_data=True,
    examples=[
        "kb label export pairs                        400 pairs, to label-pairs/",
        "kb label export pairs --sample 50 --seed 1 --out trial   50 other pairs, to trial/",
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
    out: Annotated[
        Path | None,
        typer.Option("--out", metavar="DIR", help="Write there. [default: label-WHAT]"),
    ] = None,
) -> Summary:
    """Write a sample as a project for Label Studio: config.xml, tasks.json and README.md.

    The sample is stratified (pairs by kind of keyword and timing, tasks by start_source), and each
    item carries the weight that it stands for. A larger sample of the same seed begins with the
    smaller one. Only reads. --data may be a data root or a downloaded release; a release of pairs
    holds no texts, so that the question about the text is left out.
    """
    from kb.labels import questions
    from kb.labels.export import export

    if pairs is not None and what is not JudgedKind.pairs:
        raise SettingError("--pairs names pairs, and these are tasks", hint="leave it out")
    labeling = {JudgedKind.pairs: questions.PAIRS, JudgedKind.tasks: questions.TASKS}[what]
    return export(run, labeling, sample, seed, out or Path(f"label-{what}"), pairs)


@command(
    label_app,
    "import",
    json="answers, added, labels, skipped, undefined, contradictory, purged_items, unknown_items,"
    " figures",
    needs_data=True,
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
        for name, one in section["questions"].items():
            shown = one.get("n", one["answers"])
            show_row((kind, name, shown, interval_text(one), _kappa(one.get("agreement"))))
    return summary


class TriagedKind(StrEnum):
    """What can be judged in the terminal."""

    tasks = "tasks"


@command(
    label_app,
    json="accepted_tasks, rejected_tasks, reworded_tasks, left, path",
    needs_data=True,
    examples=[
        "kb label triage tasks                        a accept, r reject, e edit, b back, q quit",
        "kb label triage tasks --annotator 2          what a second person thinks",
    ],
)
def triage(
    run: Run,
    what: Annotated[TriagedKind, typer.Argument(help="What to judge.")],
    annotator: Annotated[
        int,
        typer.Option(
            "--annotator", min=0, metavar="N", help="The number of the person who judges."
        ),
    ] = 1,
) -> Summary:
    """Accept or reject tasks in the terminal: one title at a time, one key each.

    Shows the title with its channel, the length of the video and the proposed prompt: a accepts it,
    r rejects it, e asks for a better wording, b goes back to the title before, q quits, as the end
    of input does. Each answer is written to labels/ at once, and the next run goes on with what
    this person has not judged. `kb build` then applies the answers to tasks and release.
    """
    from kb.labels.triage import triage

    return triage(run, annotator, show, sys.stdin)


def _kappa(agreement: dict[str, Any] | None) -> str:
    if agreement is None or agreement["kappa"] is None:
        return "-"
    return "{kappa:.2f} ({method}, {items} items)".format_map(agreement)
