"""films/*.parquet: the shots of the films that were seen, and what they say of pairs.

motion        m(s) is the mean of |picture at s + 1 − picture at s| over all values (0 to 255) of
              pictures of 160 x 90 pixels in three colours, s in the middle of each second; motion
              is the mean of m over the seconds whose picture and next one are in the clip
static_share  the share of these seconds with m < STILL
dark_share    the share of the clip's sampled pictures whose mean value is below DARK
cut_free_…    the stretch of the clip between two cuts or fades that contains the middle of the
              matched phrase
aligned_…     and alignable: kb.score.align, by the model that `kb pairs align` took
visual_…      duplicate_of: kb.score.visual_duplicates, by the model that scored the pairs

Everything is computed of what `kb.score.film_store` has, so no film is opened.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import pyarrow as pa

from kb.artifacts import freshness, manifest, measures
from kb.artifacts.measures import check_pairs
from kb.clips.pair_rows import by_video, pairs_of
from kb.core.context import Run
from kb.core.errors import UsageError
from kb.core.installation import np
from kb.core.summary import Summary
from kb.pairs.clip_tokens import LENGTH
from kb.schema.tables import table
from kb.score import align as alignment
from kb.score.calibration import SECTION, judgements
from kb.score.film_pass import SAMPLE_S
from kb.score.film_store import (
    SeenFilm,
    chosen_model,
    note_model,
    seen_film,
    seen_videos,
    stored_model,
)
from kb.score.visual_duplicates import CLIP, visual_duplicates
from kb.store.artifact_registry import ARTIFACTS, MANIFEST
from kb.store.layout import Layout
from kb.store.lock import taking
from kb.store.tables import database
from kb.store.tables.reading import scan
from kb.store.tables.shard_writer import write_table

STILL = (
    2.0  # neighbouring pictures hardly differ when their values (0 to 255) do by less on average
)
DARK = 24.0  # mean value (0 to 255)
_SHOTS, _FIGURES = "films/shots", "films/film_figures"
_COLUMNS = "pair_id, video_id, text, clip_start_s, clip_end_s, match_start_s, match_end_s"
_DIGITS = 4


class FilmFigures(NamedTuple):
    """Of a pair; the columns of schemas/tables/films/film_figures.toml behind the ids."""

    cuts: int
    cut_free_start_s: float
    cut_free_end_s: float
    motion: float | None
    static_share: float | None
    dark_share: float | None


def figures_of(row: dict[str, Any], seen: SeenFilm) -> FilmFigures:
    """What a film says of a pair: clip_start_s, clip_end_s, match_start_s, match_end_s."""
    start_s, end_s = row["clip_start_s"], row["clip_end_s"]
    middle = min(max((row["match_start_s"] + row["match_end_s"]) / 2, start_s), end_s)
    cuts = [shot.start_s for shot in seen.shots if start_s < shot.start_s < end_s]
    first = round(np.ceil(start_s / SAMPLE_S - 0.5))
    last = round(np.ceil(end_s / SAMPLE_S - 0.5))  # the first sample behind the clip
    motion = seen.motion[max(0, first) : max(0, last - 1)]
    motion = motion[~np.isnan(motion)]
    light = seen.light[max(0, first) : max(0, last)]
    light = light[~np.isnan(light)]
    return FilmFigures(
        len(cuts),
        max((cut for cut in cuts if cut <= middle), default=start_s),
        min((cut for cut in cuts if cut > middle), default=end_s),
        _rounded(motion.mean()) if len(motion) else None,
        _rounded((motion < STILL).mean()) if len(motion) else None,
        _rounded((light < DARK).mean()) if len(light) else None,
    )


def align(run: Run, model: str = "", *, fit: bool = False) -> Summary:
    """`kb pairs align`: aligned times of all pairs by the stored vectors of a model. `model`: as
    `kb.score.film_store.stored_model`; `fit`: fit the numbers of the profile to people's answers,
    for the user to copy.

    Raises FatalError without pairs or with pairs that are out of date, UsageError where vectors,
    the model or judgements are lacking, WriterLocked, DamagedData, DiskFull.
    """
    check_pairs(run.root)
    freshness.refuse(run, "pairs")
    name = stored_model(run.root, model)
    curve = _fitted(run, name) if fit else None
    with taking(run.root, "pairs"):
        write_figures(run, name)
        section = measures.read_measures(Layout(run.root).pairs)[alignment.SECTION]
    with database.connect(run.root) as con:
        ((cut,),) = con.sql(
            f"SELECT count(*) FROM {scan(Layout(run.root).rows('pairs/pairs'))}"
            f" WHERE token_count > {LENGTH}"
        ).fetchall()
    return Summary(
        command="pairs align",
        pairs=section["pairs"] + section["unknown"],
        aligned=section["pairs"],
        unknown=section["unknown"],
        likely=section["likely"]["hits"],
        cut_texts=cut,
        model=name,
        visible=section["visible"],
        fitted=curve,
    )


def _fitted(run: Run, model: str) -> dict[str, Any]:
    """The numbers of the curve that fit people's answers best: to clips at aligned times where
    there are any, else at spoken ones. Raises UsageError where they do not tell.
    """
    answers = judgements(run.root, alignment.SPOKEN) | judgements(run.root, alignment.ALIGNED)
    by_model = alignment.aligner(run, model)
    peaks: dict[str, float] = {}
    for rows, seen in _seen_rows(run, seen_videos(run.root)) if by_model and answers else ():
        judged = [row for row in rows if row["pair_id"] in answers]
        if judged and by_model:
            times = by_model.times(judged, seen)
            peaks |= {pair_id: aligned.peak for pair_id, aligned in times.items()}
    shown = np.array([answers[pair_id] for pair_id in peaks], bool)
    if len(shown) < alignment.LEAST or shown.all() or not shown.any():
        raise UsageError(
            f"--fit needs at least {alignment.LEAST} judged clips of which some show what is named"
            f" and some do not, and there are {len(shown)}",
            hint="people judge with `kb label export pairs` or `kb explore --judge NAME`",
        )
    curve = alignment.fitted(np.array(list(peaks.values())), shown)
    if curve is None:
        raise UsageError(
            "by people's answers a higher peak does not mean that a clip shows what is named",
            hint="align by another model, or judge more clips",
        )
    return {"align_middle": curve[0], "align_slope": curve[1], "judged": len(shown)}


def write_figures(run: Run, model: str = "") -> None:
    """Write films/ of all films that were seen, under the lock of the pairs. `model`: the one that
    aligns pairs from now on. Raises DamagedData, DiskFull.
    """
    root, videos = run.root, seen_videos(run.root)
    if not videos:
        return
    # Users may keep their films in the same folder, so it is never replaced as a whole.
    folder = ARTIFACTS["films"].folder(root)
    (folder / MANIFEST).unlink(missing_ok=True)
    by_model = alignment.aligner(run, model)
    _write_table(folder, _SHOTS, _shot_rows(run, videos))
    figures = _write_table(folder, _FIGURES, _figure_rows(run, videos, by_model))
    manifest.record(folder, "films")
    if by_model is not None:
        note_model(root, alignment.SECTION, by_model.model)
        section = alignment.section(root, by_model.model, figures)
        measures.write_measure(root, alignment.SECTION, section)


def _write_table(folder: Path, name: str, rows: Iterable[Mapping[str, Any]]) -> pa.Table:
    made = pa.Table.from_pylist(list(rows), schema=table(name).arrow())
    write_table(folder / f"{name.partition('/')[2]}-00000-of-00001.parquet", made, name)
    return made


def _shot_rows(run: Run, videos: Iterable[str]) -> Iterator[dict[str, Any]]:
    for video in videos:
        seen = seen_film(run.root, video)
        for number, shot in enumerate(seen.shots if seen is not None else ()):
            yield {"video_id": video, "shot": number, **shot._asdict()}


def _figure_rows(
    run: Run, videos: list[str], by_model: alignment.Aligner | None
) -> Iterator[dict[str, Any]]:
    duplicates = _visual_duplicates(run, videos)
    for rows, seen in _seen_rows(run, videos):
        columns = by_model.columns(rows, seen) if by_model is not None else {}
        for row in rows:
            figures = figures_of(row, seen)._asdict()
            figures["visual_duplicate_of"] = duplicates.get(row["pair_id"])
            ids = {"pair_id": row["pair_id"], "video_id": row["video_id"]}
            yield ids | figures | columns.get(row["pair_id"], {})


def _visual_duplicates(run: Run, videos: list[str]) -> dict[str, str]:
    if not (model := chosen_model(run.root, SECTION)):
        return {}
    with pairs_of(run.root, Layout(run.root).rows("pairs/pairs"), videos, CLIP) as reader:
        clips = reader.read_all()
    return visual_duplicates(run.root, model, clips)


def _seen_rows(run: Run, videos: list[str]) -> Iterator[tuple[list[dict[str, Any]], SeenFilm]]:
    """The pairs of each video whose clip begins before its film ends, and what was seen of it."""
    with pairs_of(run.root, Layout(run.root).rows("pairs/pairs"), videos, _COLUMNS) as reader:
        for own in by_video(reader):
            seen = seen_film(run.root, own[0]["video_id"])
            there = [row for row in own if seen is not None and row["clip_start_s"] < seen.end_s]
            if seen is not None and there:
                yield there, seen


def _rounded(value: Any) -> float:
    return round(float(value), _DIGITS)
