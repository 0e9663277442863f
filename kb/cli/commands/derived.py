"""`kb tasks`, `kb links`, `kb report`, `kb annotate`, `kb models`: what is made of clean tables."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from kb.cli.framework.command import command, group
from kb.cli.framework.messages import warn_stale
from kb.cli.framework.options import CLUSTER, Device, DeviceOption, Part, parse_part
from kb.core.context import Run
from kb.core.errors import KbError
from kb.core.sources import SOURCES
from kb.core.summary import Summary

tasks_app = group("Mine candidates for creative tasks from titles of videos.")


class TasksFormat(StrEnum):
    """Layouts of tasks."""

    parquet = "parquet"
    minedojo = "minedojo"


@command(
    tasks_app,
    again="Mine all titles again, even if nothing has changed.",
    json="tasks, titles, judged, reworded, starts, rejected_by",
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
    from kb.artifacts.makers import make_and_export

    return make_and_export(run, "tasks", format.value)


links_app = group("Find which videos, wiki pages and threads mention which entities.")


@command(
    links_app,
    uses=CLUSTER,
    again="Match every source again, even if its clean tables have not changed.",
    json="entities, with_page, links, mentions, sources",
    data="reads",
    records=True,
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
    from kb.artifacts.makers import make_and_export, make_artifact
    from kb.artifacts.table_catalog import Catalog

    if Catalog(run.root.absolute()).is_download:
        return make_artifact(run, "links")
    return make_and_export(run, "links")


report_app = group("Make figures and one HTML page about the collected data.")


@command(
    report_app,
    data="reads",
    records=True,
    uses=("workers",),
    json="figures, page, without",
    examples=[
        "kb report                                then open report/index.html",
        "kb report --figures                      PDFs for a paper, and word clouds",
    ],
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
    figures: Annotated[
        bool,
        typer.Option("--figures", help="Make PDFs and word clouds as well; builds repeat them."),
    ] = False,
) -> Summary:
    """Make figures (SVG, PNG) and one page that needs no network, in report/ of the data root.

    Works at any time on what has been filtered so far, on a restored data root and on a downloaded
    release. The page names sources without data.
    """
    from kb.artifacts.makers import make_artifact

    warn_stale(run)
    return make_artifact(run, "report", {"out": out, "figures": figures})


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
        help="int8 is faster, and bf16 where the GPU or processor has instructions for it; scores"
        " near the threshold are computed again in fp32, and the precision is recorded with each"
        " score. Existing scores of a lower precision than this are computed again."
        " [default: fp32 for new scores]",
    ),
]


def _add(source: str, about: str, *examples: str) -> None:
    @command(
        annotate_app,
        source,
        help=about,
        uses=CLUSTER,
        limit="Stop after scoring N more texts (exit code 3); the next run resumes.",
        json="texts, scored, known, exact_again, model, revision, precisions",
        examples=examples,
    )
    def annotate(
        run: Run,
        precision: PrecisionOption = None,
        device: DeviceOption = Device.auto,
        part: Part = None,
    ) -> Summary:
        from kb.annotate.toxicity import ToxicityScorer
        from kb.artifacts import domain_binding
        from kb.filters.filter_run import texts

        run.profile.section(source)  # raises where the profile leaves the source out
        name, own = f"annotate {source}", parse_part(part)
        scorer = ToxicityScorer.open(run, source, precision and str(precision), str(device))
        checkpoint, scores = scorer.checkpoint, scorer.scores
        if checkpoint is None or scores is None:
            return Summary(command=name, source=source, scored=0, toxicity="off in the profile")
        try:
            with domain_binding.writing(run, source):
                counts = scorer.annotate(texts(run, source), own)
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
    data="ignores",
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
