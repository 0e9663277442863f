"""A draw that others can have: release/draw, or release/draw-NAME, without text.

It is drawn from the released pairs, so that whoever downloads the same release draws the same rows
byte for byte: in a data root into its release/, of a download into `--out`.

<split>-00000-of-0000N.parquet    a split's pairs by rank: train, validation, test
videos.txt                        ids of the videos, one a line, those with the most pairs first

What was asked for is in the manifest, which the card of `kb release` tells.
"""

from __future__ import annotations

import re
import shlex
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pyarrow as pa

from kb.artifacts import domain_binding, freshness, manifest, table_catalog
from kb.core.context import Run
from kb.core.errors import FatalError, UsageError
from kb.core.installation import np
from kb.core.summary import Summary
from kb.pairs.draw import SPLIT, VIDEOS, Asked, Draw, drawn_from
from kb.schema.tables import table
from kb.store.atomic import replacing_folder
from kb.store.layout import Layout
from kb.store.tables import database
from kb.store.tables.reading import reading
from kb.store.tables.shard_writer import ROW_GROUP, write_sorted

TABLE = "draw/draw"
DEFAULT_OUT = Path("draw")
_NAME = re.compile(r"[a-z0-9][a-z0-9-]{0,40}")
_MEMORY = "250MB"  # of DuckDB, which spills what is more


def release_draw(
    run: Run, asked: Asked, name: str = "", out: Path | None = None, *, plan: bool = False
) -> Summary:
    """Draw released pairs into release/draw or release/draw-NAME of the data root, or of a download
    into `out`; with `plan` only say what would be drawn.

    Raises UsageError for a condition on what is not released, a bad name and more pairs than there
    are, FatalError without released pairs or where they are out of date, DamagedData, DiskFull.
    """
    if name and not _NAME.fullmatch(name):
        raise UsageError(
            f"--name {name!r} can't be the name of a folder",
            hint="write lower-case letters, digits and hyphens",
        )
    own = f"draw-{name}" if name else "draw"
    catalog = table_catalog.read_catalog(run.root)
    if catalog.is_download:
        place = table_catalog.outside(run.root, out or DEFAULT_OUT.with_name(own))
    elif out is not None:
        raise UsageError(
            "--out has no effect on --release, which writes into the data root",
            hint="name several draws with --name",
        )
    else:
        freshness.refuse(run, "release/pairs")
        catalog = table_catalog.read_catalog(Layout(run.root).release())
    _check_condition(asked.where)
    if not (files := catalog.files("pairs/pairs")):
        raise FatalError("there are no released pairs", hint="give --data a release with pairs")
    with (
        reading(files),
        database.connect(None, memory=_MEMORY) as con,
    ):
        made = drawn_from(run, con, catalog, asked)
    if plan:
        return made.summary
    if catalog.path == run.root.absolute():  # a download
        with replacing_folder(place) as folder:
            _write(folder, made, run)
        return Summary(made.summary, path=str(place))
    artifact = f"release/{own}"
    with domain_binding.writing(run, "release-draw"):
        inputs = manifest.inputs(run.root, artifact)
        settings = freshness.settings(run, artifact)
        with manifest.replacing(run.root, artifact, inputs=inputs, settings=settings) as build:
            _write(build.folder, made, run)
            build.figures = {**_as_asked(asked), **made.summary}
    return Summary(made.summary, path=str(Layout(run.root.absolute()).release(own)))


def _check_condition(where: str) -> None:
    """Raises UsageError where a condition names the text, which others don't have."""
    words = {word.lower() for word in re.findall(r"\w+", re.sub(r"'[^']*'", "", where))}
    if "text" in words:
        raise UsageError(
            f"--where {where!r} names the text, which is not released",
            hint="with --release a condition names released columns of pairs and quality",
        )


def _as_asked(asked: Asked) -> dict[str, Any]:
    """What the card says of it: the limits in words, and the options that draw the same."""
    limits, where = asked.limits, asked.where
    named = (
        ("--per-keyword", limits.per_keyword),
        ("--per-video", limits.per_video),
        ("--max-videos", limits.videos),
        ("--where", where and shlex.quote(where)),
    )
    options = [f"{option} {value}" for option, value in named if value]
    command = " ".join([f"kb pairs draw {asked.n} --release", *options, f"--seed {asked.seed}"])
    return {"seed": asked.seed, "where": where, "limits": limits.in_words, "command_again": command}


def _write(folder: Path, made: Draw, run: Run) -> None:
    """The files of a draw, without what `kb release` adds."""
    size = run.profile.release.shard_mb * 1e6
    for split in table(TABLE).stems:
        write_sorted(_rows(made, split), folder, TABLE, shard_bytes=size, stem=split)
    made.write_videos(folder / VIDEOS)


def _rows(made: Draw, split: str) -> Iterator[pa.Table]:
    """The rows of a split by rank."""
    pairs, side = made.pairs, list(SPLIT).index(split)
    mine = np.flatnonzero(made.sides[pairs.video] == side)
    videos, keywords = (pa.array(names, pa.string()) for names in (pairs.videos, pairs.keywords))
    for start in range(0, len(mine), ROW_GROUP):
        part = mine[start : start + ROW_GROUP]
        yield pa.table(
            {
                "pair_id": pa.array([f"{number:016x}" for number in pairs.id[part].tolist()]),
                "video_id": videos.take(pa.array(pairs.video[part])),
                "keyword": keywords.take(pa.array(pairs.keyword[part])),
                "split": pa.repeat(split, len(part)),
                "rank": pa.array(part + 1, pa.int64()),
            }
        )
