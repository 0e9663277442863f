"""`kb pairs`: keyword-matched video-text pairs out of clean transcripts."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from kb.cli.framework.command import command, group
from kb.cli.framework.options import CLUSTER
from kb.cli.framework.options import pipeline as shipped

if TYPE_CHECKING:
    from kb.core.context import Run
    from kb.core.verdict import Summary

app = group("Keyword-matched video-text pairs.")


class PairsFormat(StrEnum):
    """Layouts of pairs."""

    parquet = "parquet"
    minedojo = "minedojo"
    clip4mc = "clip4mc"
    video2dataset = "video2dataset"


@command(
    app,
    main=True,
    uses=(*CLUSTER, "pipeline"),
    limit="Stop after N more transcripts (exit code 3); the next run resumes.",
    again="Match all transcripts anew, also where nothing has changed.",
    json="pairs, videos, words, matches, keywords_found, ambiguous_alone, outside",
    needs_data=True,
    checks=True,
    examples=[
        (
            "kb pairs                                    match, grow, choose:"
            " pairs/ with text, release/pairs/ without"
        ),
        (
            "kb pairs --limit 1000                       1,000 transcripts now,"
            " the rest with the next run"
        ),
        (
            "kb pairs --format video2dataset             the list of clips that video2dataset"
            " downloads"
        ),
        (
            "kb pairs --from-index pairs-00000-of-00001.parquet   texts of a released index,"
            " from your own transcripts"
        ),
    ],
)
def pairs(
    run: Run,
    format: Annotated[
        PairsFormat,
        typer.Option("--format", help="Parquet goes to release/, others to export/FORMAT/."),
    ] = PairsFormat.parquet,
    from_index: Annotated[
        Path | None,
        typer.Option(
            "--from-index",
            metavar="FILE",
            help="Fill the text of this released index (a file or its folder) from your own"
            " transcripts.",
        ),
    ] = None,
) -> Summary:
    """Make the index of aligned clips and texts from clean/youtube: the same input gives the same
    rows.

    Pairs that are made of the same transcripts and rules are not made again.
    """
    from kb.core.errors import SettingError

    pipeline = shipped(run, "pairs")
    if from_index is None:
        pairs: Summary = pipeline.pairs(run, format.value)
        return pairs
    if format is not PairsFormat.parquet:
        raise SettingError("--from-index fills pairs/; it goes with no --format")
    if run.limit is not None or run.again:
        raise SettingError(
            "--from-index fills every text at once; it goes with no --limit, --again"
        )
    refilled: Summary = pipeline.refill(run, from_index)
    return refilled


@command(
    app,
    json="keywords, matches, ambiguous_alone",
    examples=[
        "kb pairs keywords                           hits per keyword, with three examples each",
        "kb pairs keywords --kind block --videos 500 blocks, in 500 transcripts",
        "kb pairs keywords --unused --examples 0     keywords without a hit as well, no examples",
    ],
)
def keywords(
    run: Run,
    examples: Annotated[
        int,
        typer.Option(
            "--examples", min=0, max=100, metavar="N", help="Examples in context for each keyword."
        ),
    ] = 3,
    kind: Annotated[
        str,
        typer.Option(
            "--kind", metavar="KIND", help="Keywords of one kind: entity, block, item, biome …"
        ),
    ] = "",
    unused: Annotated[
        bool, typer.Option("--unused", help="List keywords without a hit as well.")
    ] = False,
    videos: Annotated[
        int,
        typer.Option("--videos", min=0, metavar="N", help="Read that many transcripts; 0: all."),
    ] = 0,
) -> Summary:
    """Print hits per keyword and examples in context, so that a person can judge the list.

    Columns: keyword, kind, rule, matches, and how many of an everyday word stood alone and make no
    pair.
    """
    from kb.core import terminal
    from kb.core.verdict import Summary
    from kb.pairs.keyword_hits import keyword_lines

    count = total = alone = 0
    typer.echo("keyword\tkind\trule\tmatches\talone")
    for line in keyword_lines(run, examples, kind, unused, videos):
        cells = line.keyword, line.kind, line.rule, line.matches, line.alone
        typer.echo("\t".join(terminal.one_line(str(cell)) for cell in cells))
        for example in line.examples:
            typer.echo(f"    {terminal.one_line(example)}")
        count, total, alone = count + 1, total + line.matches, alone + line.alone
    return Summary(command="pairs keywords", keywords=count, matches=total, ambiguous_alone=alone)
