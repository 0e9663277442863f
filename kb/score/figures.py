"""films/*.parquet: the shots of the films that were seen, and what they say of pairs.

motion        m(s) is the mean of |picture at s + 1 − picture at s| over all values (0 to 255) of
              pictures of 160 x 90 pixels in three colours, s in the middle of each second; motion
              is the mean of m over the seconds whose picture and next one are in the clip
static_share  the share of these seconds with m < STILL
dark_share    the share of the clip's sampled pictures whose mean value is below DARK
cut_free_…    the stretch of the clip between two cuts or fades that contains the middle of the
              matched phrase

visual_…      of clips that show the same (kb.score.visual_duplicates)

Everything is computed of what `kb.score.film_store` has, so no film is opened.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from itertools import groupby
from operator import itemgetter
from typing import Any, NamedTuple

import pyarrow as pa

from kb.artifacts import manifest, measures
from kb.core.context import Run
from kb.core.installation import np
from kb.schema.tables import table
from kb.score.film_pass import SAMPLE_S
from kb.score.film_store import SeenFilm, seen_film, seen_videos
from kb.score.visual_duplicates import CLIP, visual_duplicates
from kb.store.artifact_registry import ARTIFACTS, MANIFEST
from kb.store.layout import Layout
from kb.store.tables import database
from kb.store.tables.reading import scan
from kb.store.tables.shard_writer import write_table

STILL = (
    2.0  # neighbouring pictures hardly differ when their values (0 to 255) do by less on average
)
DARK = 24.0  # mean value (0 to 255)
_SHOTS, _FIGURES = "films/shots", "films/film_figures"
_COLUMNS = "pair_id, video_id, clip_start_s, clip_end_s, match_start_s, match_end_s"
_DIGITS = 4


class FilmFigures(NamedTuple):
    """Of a pair and its film alone; columns of schemas/tables/films/film_figures.toml."""

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


def write_figures(run: Run) -> None:
    """Write films/ of all films that were seen, under the lock of the pairs. Raises DamagedData,
    DiskFull.
    """
    root, videos = run.root, seen_videos(run.root)
    if not videos:
        return
    # Users may keep their films in the same folder, so it is never replaced as a whole.
    folder = ARTIFACTS["films"].folder(root)
    (folder / MANIFEST).unlink(missing_ok=True)
    for name, rows in (
        (_SHOTS, _shot_rows(run, videos)),
        (_FIGURES, _figure_rows(run, videos)),
    ):
        names = table(name).names()
        dictionaries = [dict(zip(names, row, strict=True)) for row in rows]
        made = pa.Table.from_pylist(dictionaries, schema=table(name).arrow())
        write_table(folder / f"{name.partition('/')[2]}-00000-of-00001.parquet", made, name)
    manifest.record(folder, "films")


def _shot_rows(run: Run, videos: Iterable[str]) -> Iterator[tuple[Any, ...]]:
    for video in videos:
        seen = seen_film(run.root, video)
        for number, shot in enumerate(seen.shots if seen is not None else ()):
            yield video, number, *shot


def _figure_rows(run: Run, videos: list[str]) -> Iterator[tuple[Any, ...]]:
    with database.connect(run.root) as con:
        con.register("seen", pa.table({"video_id": pa.array(videos, pa.string())}))
        asked = f"""
            SELECT {_COLUMNS} FROM {scan(Layout(run.root).rows("pairs/pairs"))}
            SEMI JOIN seen USING (video_id) ORDER BY video_id, pair_id"""
        scored = measures.read_measures(Layout(run.root).pairs).get("scores", {"models": []})
        duplicates: dict[str, str] = {}
        for model in scored["models"]:  # the one that scored the pairs
            clips = con.sql(f"SELECT {CLIP} FROM ({asked})").to_arrow_table()
            duplicates = visual_duplicates(run.root, model, clips)
        reader = con.sql(asked).to_arrow_reader()
        rows = (row for batch in reader for row in batch.to_pylist())
        for video, own in groupby(rows, key=itemgetter("video_id")):
            seen = seen_film(run.root, video)
            for row in own:
                if seen is not None and row["clip_start_s"] < seen.end_s:
                    pair_id = row["pair_id"]
                    yield pair_id, video, *figures_of(row, seen), duplicates.get(pair_id)


def _rounded(value: Any) -> float:
    return round(float(value), _DIGITS)
