"""`kb clips`: the clips of pairs, cut out of the user's own video files."""

from __future__ import annotations

import re
from enum import StrEnum
from pathlib import Path
from typing import Annotated, Any, cast

import typer

from kb.cli.framework.command import command, group
from kb.cli.framework.options import (
    CLUSTER,
    Alignable,
    Aligned,
    Films,
    OnlyPairs,
    Part,
    Plan,
    least_alignable,
    parse_part,
)
from kb.core.context import Run
from kb.core.errors import SettingError
from kb.core.summary import Summary

app = group("Cut the clips of pairs out of your own video files.")


class ClipFormat(StrEnum):
    """Layouts of clips."""

    webdataset = "webdataset"
    npz = "npz"


class FrameFit(StrEnum):
    """How a frame fills another ratio of sides."""

    stretch = "stretch"
    crop = "crop"
    pad = "pad"


@command(
    app,
    uses=CLUSTER,
    json="pairs, clips, missing, short, undecodable, film_differs, not_aligned, videos,"
    " unknown_length, path",
    planned=(
        "videos",
        "keyword",
        "pairs",
        "where",
        "sample",
        "within_shot",
        "part",
        "aligned",
        "alignable",
        "size",
        "frames",
        "format",
    ),
    data="reads",
    records=True,
    examples=[
        "kb clips --videos films --plan                    files, hours and size; cuts nothing",
        "kb clips --videos films --out clips               webdataset shards, 16 frames per clip",
        "kb clips --videos films --keyword creeper --sample 100 --format npz",
        "kb clips --videos films --pairs draw/pairs.parquet   those that `kb pairs draw` drew",
        "kb clips --videos films --part 1/3                   the first of three machines",
        "kb clips --videos films --aligned --alignable 0.5    at times that `kb pairs align` found",
    ],
)
def clips(
    run: Run,
    videos: Films,
    out: Annotated[
        Path, typer.Option("--out", metavar="DIR", help="Write the clips there.")
    ] = Path("clips"),
    frames: Annotated[
        int, typer.Option("--frames", min=1, max=100, metavar="N", help="Frames of a clip.")
    ] = 16,
    size: Annotated[
        str, typer.Option("--size", metavar="HEIGHTxWIDTH", help="Height and width in px.")
    ] = "160x256",
    fit: Annotated[
        FrameFit,
        typer.Option(
            "--fit",
            help="stretch changes the ratio of the sides, crop cuts the rims, pad adds black.",
        ),
    ] = FrameFit.stretch,
    format: Annotated[
        ClipFormat,
        typer.Option("--format", help="Tar shards with JPEG frames, or one .npz per clip."),
    ] = ClipFormat.webdataset,
    keyword: Annotated[
        str, typer.Option("--keyword", metavar="K", help="Only pairs of this keyword.")
    ] = "",
    pairs: OnlyPairs = None,
    where: Annotated[
        str,
        typer.Option(
            "--where", metavar="SQL", help="Only pairs that meet a condition on their columns."
        ),
    ] = "",
    sample: Annotated[
        int | None, typer.Option("--sample", min=1, metavar="N", help="Random sample of N pairs.")
    ] = None,
    within_shot: Annotated[
        bool,
        typer.Option(
            "--within-shot",
            help="Of each clip only the stretch without a cut, as `kb pairs score` has seen it.",
        ),
    ] = False,
    part: Part = None,
    aligned: Aligned = False,
    alignable: Alignable = None,
    plan: Plan = False,
) -> Summary:
    """Cut the clips of pairs out of video files that you have.

    Files are found by the video's id: ID.mp4, TITLE [ID].webm, ID/video.mkv. The frames are those
    shown at the centres of equal parts of the clip. Every pair without a clip is in left_out.csv
    with the reason. A run that was stopped resumes. With --part the files of all parts, copied into
    one folder, are those of one machine. Lorecrawl downloads no video.
    """
    from kb.clips import build
    from kb.clips.clip_files import CutOptions

    sides = re.fullmatch(r"(\d{1,4})x(\d{1,4})", size)
    if not sides or "0" in sides.groups():
        raise SettingError(f"--size is {size!r}", hint="write height and width: --size 160x256")
    options = CutOptions(
        frames,
        (int(sides[1]), int(sides[2])),
        cast("Any", fit.value),
        cast("Any", format.value),
        run.profile.clips.jpeg_quality,
    )
    folders = [folder.expanduser().absolute() for folder in videos]
    least = least_alignable(aligned, alignable)
    if aligned and within_shot:
        raise SettingError("--within-shot can't be combined with --aligned: it is of spoken times")
    own = parse_part(part)
    chosen = build.Chosen(keyword, pairs, where, sample, within_shot, own, aligned=least)
    if plan:
        return build.plan(run, folders, options, chosen)
    return build.build(run, folders, out, options, chosen)
