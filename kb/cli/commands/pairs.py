"""`kb pairs`: keyword-matched video-text pairs from clean transcripts."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from kb.cli.framework.command import command, group
from kb.cli.framework.messages import show_row
from kb.cli.framework.options import (
    CLUSTER,
    Alignable,
    Aligned,
    Device,
    DeviceOption,
    OnlyPairs,
    Part,
    Plan,
    least_alignable,
    parse_part,
)
from kb.core.config.pipeline import recipe_of
from kb.core.context import Run
from kb.core.errors import SettingError
from kb.core.summary import Summary, interval_text

app = group("Make keyword-matched video-text pairs.")


class PairsFormat(StrEnum):
    """Layouts of pairs."""

    parquet = "parquet"
    minedojo = "minedojo"
    video2dataset = "video2dataset"


@command(
    app,
    main=True,
    uses=CLUSTER,
    again="Match all transcripts again, even if nothing has changed.",
    json="pairs, videos, words, matches, keywords_in_pairs, keywords_found, ambiguous_alone,"
    " outside",
    checks=True,
    examples=[
        ("kb pairs                                    pairs/ with text, release/pairs/ without"),
        (
            "kb pairs --format video2dataset             a list of clips for video2dataset to"
            " download"
        ),
        (
            "kb pairs --from-index pairs-00000-of-00001.parquet   fill in a released index"
            " from your own transcripts"
        ),
    ],
)
def pairs(
    run: Run,
    format: Annotated[
        PairsFormat,
        typer.Option("--format", help="Parquet goes to release/, other formats to export/FORMAT/."),
    ] = PairsFormat.parquet,
    from_index: Annotated[
        Path | None,
        typer.Option(
            "--from-index",
            metavar="FILE",
            help="Fill in the texts of this released index (a file or its folder) from your own"
            " transcripts.",
        ),
    ] = None,
) -> Summary:
    """Make the index of aligned clips and texts from clean/youtube.

    The same input gives the same rows. Pairs that are up to date are not made again.
    """
    from kb.artifacts.makers import make_and_export

    if from_index is None:
        return make_and_export(run, "pairs", format.value)
    if format is not PairsFormat.parquet:
        raise SettingError("--from-index can't be combined with --format: it always fills pairs/")
    if run.again:
        raise SettingError("--from-index can't be combined with --again: it fills in all texts")
    from kb.pairs.restore import refill

    return refill(run, from_index)


@command(
    app,
    json="pairs, out_of, keywords, most_of_a_keyword, videos, hours, train, validation, test, path",
    planned=(
        *("n", "per_keyword", "per_video", "max_videos", "where", "seed", "out"),
        *("release", "name", "aligned", "alignable"),
    ),
    data="reads",
    examples=[
        "kb pairs draw 640000                        as many as the paper sampled",
        "kb pairs draw 640000 --release              release/draw, for others to have",
        "kb pairs draw 10000 --per-video 20 --plan   what would be drawn; writes nothing",
        "kb pairs draw 5000 --where \"language = 'en' AND duplicate_of IS NULL\" --seed 1",
    ],
)
def draw(
    run: Run,
    n: Annotated[int, typer.Argument(metavar="N", min=1, help="How many pairs to draw.")],
    per_keyword: Annotated[
        int, typer.Option("--per-keyword", min=0, metavar="M", help="At most M pairs of a keyword.")
    ] = 0,
    per_video: Annotated[
        int, typer.Option("--per-video", min=0, metavar="K", help="At most K pairs of a video.")
    ] = 0,
    max_videos: Annotated[
        int,
        typer.Option(
            "--max-videos",
            min=0,
            metavar="V",
            help="Draw from V videos: those with the most pairs, of which rare keywords count"
            " more.",
        ),
    ] = 0,
    where: Annotated[
        str,
        typer.Option(
            "--where",
            metavar="SQL",
            help="Only pairs that meet this condition on the columns of pairs, quality, scores and"
            " labels.",
        ),
    ] = "",
    seed: Annotated[
        int | None,
        typer.Option(
            "--seed", metavar="S", help="Another seed draws other pairs. [default: the profile's]"
        ),
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option("--out", metavar="DIR", help="Write the draw there. [default: draw]"),
    ] = None,
    release: Annotated[
        bool,
        typer.Option(
            "--release",
            help="Draw from the released pairs into release/draw, without text; of a download, into"
            " --out.",
        ),
    ] = False,
    name: Annotated[
        str,
        typer.Option("--name", metavar="NAME", help="With --release: write release/draw-NAME."),
    ] = "",
    aligned: Aligned = False,
    alignable: Alignable = None,
    plan: Annotated[
        bool, typer.Option("--plan", help="Print what would be drawn; write nothing.")
    ] = False,
) -> Summary:
    """Draw N pairs at random, spread evenly over keywords, with a split for training.

    All pairs of a rare keyword are drawn, and up to a common number of a frequent one; within a
    keyword they are spread evenly over videos. No limits apply unless asked for. pairs.parquet has
    the columns of pairs and quality and `split` (train, validation, test: 90, 5 and 5 %, whole
    channels and whole clusters of duplicates on one side), videos.txt the videos that they need,
    README.md what was drawn. With --aligned only pairs that `kb pairs align` has found times for
    are drawn, and their clips have these times.

    --release makes a draw that others can have: ids, splits and ranks, which `kb release` describes
    and whoever has the same release draws again byte for byte.
    """
    from kb.pairs.draw import Asked, Limits
    from kb.pairs.draw import draw as drawn
    from kb.pairs.release_draw import DEFAULT_OUT, release_draw

    limits = Limits(per_keyword, per_video, max_videos)
    least = least_alignable(aligned, alignable)
    asked = Asked(n, limits, where, run.seed if seed is None else seed, least)
    if release and aligned:
        raise SettingError("--aligned can't be combined with --release: that draw has no times")
    if release:
        return release_draw(run, asked, name, out, plan=plan)
    if name:
        raise SettingError(
            "--name has no effect without --release", hint="name a folder with --out"
        )
    return drawn(run, asked, out or DEFAULT_OUT, plan=plan)


@command(
    app,
    uses=CLUSTER,
    json="pairs, scored, missing, short, undecodable, film_differs, no_text, videos,"
    " unknown_length, model, visible, path",
    planned=("videos", "pairs", "model", "sample", "part"),
    examples=[
        "kb pairs score --videos films --model ViT-B-16.pt   all pairs whose film is in films",
        "kb pairs score --videos films --sample 1000         the model of `kb models fetch clip`",
        "kb pairs score --videos films --pairs draw/pairs.parquet",
        "kb pairs score --videos films --part 1/3            the first of three machines",
        "kb pairs score --videos films --engine dask --scheduler tcp://10.0.0.1:8786",
        "kb pairs score --videos films --plan                hours of films and size of vectors",
    ],
)
def score(
    run: Run,
    videos: Annotated[
        list[Path] | None,
        typer.Option(
            "--videos",
            metavar="DIR",
            help="A folder with video files; may be given repeatedly. Without it scores are"
            " computed of what is stored of films.",
        ),
    ] = None,
    pairs: OnlyPairs = None,
    model: Annotated[
        Path | None,
        typer.Option(
            "--model",
            metavar="FOLDER|FILE",
            help="A CLIP model: a folder of transformers, or a state dict of OpenAI's CLIP,"
            " open_clip or MineCLIP. [default: what `kb models fetch clip` stored]",
        ),
    ] = None,
    sample: Annotated[
        int | None, typer.Option("--sample", min=1, metavar="N", help="Random sample of N pairs.")
    ] = None,
    device: DeviceOption = Device.auto,
    part: Part = None,
    plan: Plan = False,
) -> Summary:
    """Score how well clips show what texts say, with a CLIP model and your own video files.

    Writes pairs/scores-*.parquet: similarity, margin over the texts of other clips of the video,
    the offset at which the picture fits best, and the share of static frames; films/*.parquet: the
    shots of each film, and cuts and motion within each clip. Each film is decoded once; what was
    seen of it is kept in annotations/films, so films may go afterwards. pairs/measures.json
    and the card get their distribution and, where people judged pairs, what share of them shows
    what is named at each score, which is printed too, a row for each of ten bins. A run that was
    stopped resumes, and a film that was seen is not decoded again. Lorecrawl downloads no video.
    """
    from kb.clips.build import Chosen
    from kb.score import build

    folders = [folder.expanduser().absolute() for folder in videos or ()]
    chosen = Chosen("", pairs, "", sample, part=parse_part(part))
    if plan:
        return build.plan(run, folders, model, chosen)
    summary = build.score(run, folders, model, chosen, str(device))
    seen = summary["visible"]
    if not seen["judged"]:
        run.progress.say(
            "nobody has judged these clips, so no similarity is known to mean anything;"
            " `kb label export pairs` makes a project to judge them"
        )
        return summary
    show_row(("similarity", "judged", "show what is named"))
    for judged in seen["bins"]:
        show_row(
            (f"{judged['from']:.3f} to {judged['to']:.3f}", judged["n"], interval_text(judged))
        )
    if seen["reached_from"]:
        reached = seen["reached_from"]
        show_row((f"{reached['similarity']:.3f} or more", reached["n"], interval_text(reached)))
    return summary


@command(
    app,
    json="pairs, aligned, unknown, likely, cut_texts, model, visible, fitted",
    examples=[
        "kb pairs align                              by the model whose vectors are stored",
        "kb pairs align --model ViT-B-16             by one of several",
        "kb pairs align --fit                        the profile's two numbers by judgements",
    ],
)
def align(
    run: Run,
    model: Annotated[
        str,
        typer.Option(
            "--model",
            metavar="NAME",
            help="By the vectors of this model: its name, as in pairs/scores, or its file's.",
        ),
    ] = "",
    fit: Annotated[
        bool,
        typer.Option(
            "--fit",
            help="Fit score.align_middle and score.align_slope to what people said of clips, and"
            " print the lines for the profile.",
        ),
    ] = False,
) -> Summary:
    """Find where in its film the text of each pair is shown, and whether at all.

    From the vectors that `kb pairs score` stored, so no film is opened. films/film_figures gets
    aligned_start_s and aligned_end_s, a stretch as long as the clip and at most 20 s from it, and
    alignable, how probable it is that the text is shown there. Pairs and films that are made later
    get them as well. `kb clips`, `kb pairs draw` and torch take these times with --aligned.

    Columns: the least that `alignable` is; judged clips at spoken times and the share of them that
    shows what is named; the same at aligned times.
    """
    from kb.score import figures

    summary = figures.align(run, model, fit=fit)
    judged = [row for row in summary["visible"] if row["spoken"]["n"] or row["aligned"]["n"]]
    if not judged:
        run.progress.say(
            "nobody has judged these clips, so it is not known whether aligned times are better;"
            " `kb label export pairs --aligned` makes a project to judge them"
        )
    else:
        show_row(("alignable", "judged", "spoken", "judged", "aligned"))
    for row in judged:
        shares = ((row[name]["n"], interval_text(row[name])) for name in ("spoken", "aligned"))
        show_row(
            (f"{row['alignable_from']:.1f} or more", *(cell for pair in shares for cell in pair))
        )
    if curve := summary["fitted"]:
        for name in ("align_middle", "align_slope"):
            show_row([f"score.{name} = {curve[name]}"])
    return summary


@command(
    app,
    uses=("wait",),
    json="speech_recognition, videos_with_both_tracks, videos_compared, fetched, failed, requests",
    planned=("sample",),
    checks=True,
    examples=[
        "kb pairs measure --plan                     how many videos have both tracks",
        "kb pairs measure --sample 200               fetch and compare 200 of them",
    ],
)
def measure(
    run: Run,
    sample: Annotated[
        int, typer.Option("--sample", min=1, metavar="N", help="Fetch tracks of at most N videos.")
    ] = 200,
    plan: Plan = False,
) -> Summary:
    """Estimate how often speech recognition gets the profile's keywords wrong.

    Draws kept videos that have both a manual and an automatic track, fetches the automatic one
    (three requests per video) and compares the keywords of the two, also of videos whose track was
    fetched before. A larger sample begins with the smaller one; no track is fetched twice.
    pairs/measures.json gets the shares with their 95 % intervals, and the card of the pairs shows
    them.

    Columns: kind of keyword; how often keywords occur in the automatic tracks, in the manual ones
    and at the same time in both; the share of those in automatic tracks that the manual track has
    too, and the reverse.
    """
    recipe = recipe_of(run.profile, "pairs")
    if plan:
        planned: Summary = recipe.defined("plan_measure")(run, sample)
        return planned
    summary: Summary = recipe.defined("measure")(run, sample)
    section = summary["speech_recognition"]
    show_row(("kind", "automatic", "manual", "both", "manual|automatic", "automatic|manual"))
    for kind, compared in {**section["keywords_by_kind"], "all": section["keywords"]}.items():
        counts = (compared["in_automatic"], compared["in_manual"], compared["in_both"])
        shares = (compared["manual_given_automatic"], compared["automatic_given_manual"])
        show_row((kind, *counts, *map(interval_text, shares)))
    return summary


@command(
    app,
    json="keywords, matches, ambiguous_alone",
    data="reads",
    examples=[
        "kb pairs keywords                           matches per keyword, with three examples each",
        "kb pairs keywords --kind block --videos 500 blocks only, in 500 transcripts",
        "kb pairs keywords --unused --examples 0     with keywords that never match, no examples",
    ],
)
def keywords(
    run: Run,
    examples: Annotated[
        int,
        typer.Option(
            "--examples", min=0, max=100, metavar="N", help="Examples per keyword, in context."
        ),
    ] = 3,
    kind: Annotated[
        str,
        typer.Option(
            "--kind",
            metavar="KIND",
            help="Only keywords of this kind: entity, block, item …",
        ),
    ] = "",
    unused: Annotated[
        bool, typer.Option("--unused", help="Also list keywords that never match.")
    ] = False,
    videos: Annotated[
        int,
        typer.Option("--videos", min=0, metavar="N", help="Read only N transcripts; 0: all."),
    ] = 0,
) -> Summary:
    """Print matches per keyword with examples in context, to help judge the keyword list.

    Columns: keyword, kind, rule, matches, and `alone`: how often an everyday word stood without
    another keyword nearby, which makes no pair.
    """
    from kb.pairs.keyword_hits import keyword_lines

    count = total = alone = 0
    show_row(("keyword", "kind", "rule", "matches", "alone"))
    for line in keyword_lines(run, examples, kind, unused, videos):
        show_row((line.keyword, line.kind, line.rule, line.matches, line.alone))
        for example in line.examples:
            show_row([example], indent="    ")
        count, total, alone = count + 1, total + line.matches, alone + line.alone
    return Summary(command="pairs keywords", keywords=count, matches=total, ambiguous_alone=alone)
