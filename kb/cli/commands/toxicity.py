"""`kb annotate` and `kb models`: toxicity scores, and the model that computes them."""

from __future__ import annotations

from enum import StrEnum
from typing import Annotated

import typer

from kb.cli.framework.command import command, group
from kb.cli.framework.options import CLUSTER
from kb.core.context import Run
from kb.core.errors import KbError
from kb.core.sources import SOURCES
from kb.core.summary import Summary

annotate_app = group("Score text for toxicity. `filter` does this as well.")
models_app = group("Download the toxicity model.")


class Precision(StrEnum):
    """Precision of the model's numbers."""

    fp32 = "fp32"
    bf16 = "bf16"
    int8 = "int8"


class Device(StrEnum):
    """Where the model runs."""

    auto = "auto"
    cpu = "cpu"
    cuda = "cuda"


PrecisionOption = Annotated[
    Precision | None,
    typer.Option(
        "--precision",
        help="bf16 and int8 are faster; scores near the threshold are computed again in fp32, and"
        " the precision is recorded with each score. Existing scores of a lower precision than"
        " this are computed again. [default: fp32 for new scores]",
    ),
]
DeviceOption = Annotated[
    Device,
    typer.Option("--device", help="Where the model runs; auto uses a GPU if there is one."),
]


def _annotate(run: Run, source: str, precision: Precision | None, device: Device) -> Summary:
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
        return _annotate(run, source, precision, device)


for _name, _source in SOURCES.items():
    _examples = _source.annotate_examples or (f"kb annotate {_name}",)
    _add(_name, _source.annotate_help, *_examples)


@command(
    models_app,
    without=("data", "profile"),
    json="model, fetched, present, bytes, folder",
    examples=[
        "kb models fetch                the model of the paper, Detoxify `original`",
        "kb models fetch unbiased       another model; then set KB_TOXICITY_MODEL=unbiased",
    ],
)
def fetch(
    run: Run,
    name: Annotated[
        str,
        typer.Argument(
            metavar="[NAME]",
            help="original, unbiased, multilingual, original-small or unbiased-small.",
        ),
    ] = "original",
) -> Summary:
    """Download a published checkpoint with its configuration and vocabulary, and verify them.

    An interrupted download resumes. The files are kept in the user's cache, for all data roots.
    """
    from kb.annotate.fetch import fetch as room

    return room(run, name)
