"""Pairs and the user's own video files → training clips, in shards of some videos.

<out>/clips-00000.tar       webdataset: a clip's frames, row, times and tokens
<out>/<video>/<pair>.npz    the same with --format npz
<out>/clips-00000.json      what became of the pairs of these videos, and of what it was made
<out>/left_out.csv          pairs without a clip, and why; left_out-2-of-4.csv those of a part

A shard has videos with neighbouring ids, with a file or without, so that another file changes one
shard. A run that was stopped goes on with the shards that are left; one whose pairs, films or
options have changed is made again. The second of four parts is the second of every four shards, so
the files of the parts, brought into one folder, are those of one machine.
"""

from __future__ import annotations

import contextlib
import csv
import hashlib
import io
from collections import Counter
from collections.abc import Iterator, Sequence
from itertools import compress, islice
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import msgspec

from kb.artifacts import freshness, table_catalog
from kb.artifacts.table_catalog import Catalog
from kb.clips.clip_files import (
    NOT_ALIGNED,
    CutOptions,
    LeftOut,
    Row,
    ShardReport,
    Writer,
    shard_report,
    writer_of,
)
from kb.clips.clip_sources import cut, frame_times
from kb.clips.film_lookup import (
    FILM_DIFFERS,
    MISSING,
    UNDECODABLE,
    Found,
    film_digest,
    find_films,
)
from kb.clips.frames import UndecodableVideo
from kb.clips.pair_rows import by_video
from kb.core.context import Run
from kb.core.engine import executor_of_tasks, map_in_order
from kb.core.errors import UsageError
from kb.core.installation import require
from kb.core.suggestions import similar
from kb.core.summary import Summary
from kb.pairs.pair_selection import asking, checked
from kb.store.atomic import write_bytes, write_text
from kb.store.leftovers import remove_temporary_in
from kb.store.tables import database
from kb.store.tables.reading import reading, scan

if TYPE_CHECKING:
    from duckdb import DuckDBPyConnection

_VIDEOS = 16  # of a shard
_BATCH = 2048  # rows that are read at a time
_MEMORY = "1GB"  # of DuckDB, which spills what is more
_JPEG_SHARE = 0.1  # of the bytes of a frame, for the plan
SHORT = "short"
_REASONS = (MISSING, SHORT, UNDECODABLE, FILM_DIFFERS, NOT_ALIGNED)
_COLUMNS = "pair_id, video_id, keyword, keyword_kind, clip_start_s, clip_end_s, text"
# By which videos are dealt out to parts: a number that new videos don't change, or their shard's.
BY_VIDEO = "('0x' || left(sha256(video_id), 16))::UBIGINT"
_SHARD = f"(dense_rank() OVER (ORDER BY video_id) - 1) // {_VIDEOS}"


class Chosen(NamedTuple):
    """Which pairs: of a keyword, of a file with `pair_id`, by a condition in DuckDB's SQL on the
    columns of pairs and quality (or of the file), a sample of so many. `within_shot`: those whose
    film was seen, and of each clip the stretch without a cut. `part`: (2, 4) for the second of four
    parts of their videos, which `selected` says how to make. `aligned`: times of `kb pairs align`,
    of pairs that are alignable at least so much; the others have none.
    """

    keyword: str = ""
    pairs: Path | None = None
    where: str = ""
    sample: int | None = None
    within_shot: bool = False
    part: tuple[int, int] | None = None
    aligned: float | None = None


class Selection(NamedTuple):
    """Chosen pairs. `found`: the films of their videos. `videos`: every video's id. `rows`: the
    pairs of one video after the other, by time; they can be read once.
    """

    found: Found
    videos: list[str]
    rows: Iterator[list[Row]]


def plan(run: Run, folders: Sequence[Path], options: CutOptions, chosen: Chosen) -> Summary:
    """What a run would cut: files, clips, hours and size. Decodes and writes nothing."""
    _require()
    clips, left_out = 0, Counter[str]()
    seconds = 0.0
    with selected(run, folders, chosen, _COLUMNS, _SHARD) as (found, _, rows):
        for row in (row for own in rows for row in own):
            if lack := _lack(row, found):
                left_out[lack.reason] += 1
            else:
                clips += 1
                seconds += row["clip_end_s"] - row["clip_start_s"]
    height, width = options.size
    share = _JPEG_SHARE if options.format == "webdataset" else 1
    size = clips * options.frames * height * width * 3 * share
    return Summary(
        command="clips",
        pairs=clips + left_out.total(),
        **{r: left_out[r] for r in (MISSING, UNDECODABLE, FILM_DIFFERS, NOT_ALIGNED)},
        videos=len(found.films),
        unknown_length=found.unknown,
        hours=round(seconds / 3600, 2),
        gigabytes=round(size / 1e9, 2),
    )


def build(
    run: Run, folders: Sequence[Path], out: Path, options: CutOptions, chosen: Chosen
) -> Summary:
    """Cut the clips that are not cut yet. pairs = clips + missing + short + undecodable +
    film_differs + not_aligned.

    Raises FatalError without pairs, UsageError for a wrong folder, MissingExtra, DiskFull,
    Interrupted; the same call resumes.
    """
    place = table_catalog.outside(run.root, out)
    _require()
    remove_temporary_in(place)
    left_out: list[LeftOut] = []
    clips = 0
    number, parts = chosen.part or (1, 1)
    with selected(run, folders, chosen, _COLUMNS, _SHARD) as (found, videos, rows):
        films = found.films
        starts = range(0, len(videos), _VIDEOS)
        names = {
            at: f"clips-{at // _VIDEOS * parts + number - 1:05d}"
            for at in starts
            if not films.keys().isdisjoint(videos[at : at + _VIDEOS])
        }
        for path in place.glob("clips-[0-9]*.*") if place.is_dir() else ():
            shard = path.stem.removeprefix("clips-")
            ours = shard.isdecimal() and int(shard) % parts == number - 1
            if ours and path.stem not in names.values():  # of films that are gone
                path.unlink()

        def todo() -> Iterator[tuple[str, str, list[tuple[str, list[Row]]], CutOptions]]:
            for at in starts:
                shard = list(islice(rows, _VIDEOS))
                every = (_lack(row, found) for own in shard for row in own)
                lacks = {lack.pair_id: lack for lack in every if lack is not None}
                left_out.extend(lacks.values())
                if at in names:
                    timed = ([row for row in own if row["pair_id"] not in lacks] for own in shard)
                    cut_from = [(str(films[own[0]["video_id"]]), own) for own in timed if own]
                    yield str(place), names[at], cut_from, options

        with (
            run.progress.task("clips", total=len(names), unit="shards") as task,
            executor_of_tasks(run, len(names), place, folders) as executor,
        ):
            for report in map_in_order(executor, cut_shard, todo(), window=executor.window):
                clips += len(report.clips)
                left_out.extend(report.left_out)
                task.advance(1, clips=len(report.clips))
    _write_left_out(place, f"left_out-{number}-of-{parts}.csv" if chosen.part else "", left_out)
    counts = Counter(pair.reason for pair in left_out)
    return Summary(
        command="clips",
        pairs=clips + len(left_out),
        clips=clips,
        **{reason: counts[reason] for reason in _REASONS},
        videos=len(films),
        unknown_length=found.unknown,
        path=str(place),
    )


def _lack(row: Row, found: Found) -> LeftOut | None:
    """Why a pair has no clip, as far as is known before its film is opened."""
    pair_id, video_id = row["pair_id"], row["video_id"]
    if row["clip_start_s"] is None:
        return LeftOut(pair_id, video_id, NOT_ALIGNED, "not alignable enough, or not known to be")
    if video_id not in found.films:
        return LeftOut(pair_id, video_id, *found.reason(video_id))
    return None


def _require() -> None:
    require("clips", "av", "PIL", "tokenizers")


@contextlib.contextmanager
def selected(
    run: Run, folders: Sequence[Path], chosen: Chosen, columns: str, dealt: str = BY_VIDEO
) -> Iterator[Selection]:
    """These columns of the chosen pairs (video_id and text among them) and their videos' files.
    `dealt`: a number in SQL by which videos are dealt out to parts in turn.

    Raises FatalError without pairs or with pairs that are out of date, UsageError for a wrong
    folder or condition, DamagedData.
    """
    for folder in folders:
        if not folder.is_dir():
            raise UsageError(f"--videos {folder} is not a folder")
    freshness.refuse(run, "pairs")
    catalog = table_catalog.read_catalog(run.root)
    asked = asking(
        catalog,
        chosen.pairs,
        chosen.where,
        within_shot=chosen.within_shot,
        aligned=chosen.aligned,
    )
    number, parts = chosen.part or (1, 1)
    values = {
        "keyword": chosen.keyword,
        "seed": str(run.seed),
        "sample": 1 << 62 if chosen.sample is None else chosen.sample,
    }
    with (
        reading(catalog.files("pairs/pairs")),
        database.connect(catalog.spill, memory=_MEMORY) as con,
    ):
        every = f"""
            SELECT {columns}
            FROM ({checked(con, asked, chosen.where)})
            WHERE $keyword = '' OR lower(keyword) = lower($keyword)
            QUALIFY row_number() OVER (ORDER BY md5($seed || ' ' || pair_id), pair_id) <= $sample"""
        con.sql(
            f"""
            SELECT * EXCLUDE turn
            FROM (SELECT *, {dealt if chosen.part else 0} AS turn FROM ({every}))
            WHERE turn % {parts} = {number - 1}
            ORDER BY video_id, clip_start_s, pair_id""",
            params=values,
        ).create("chosen")
        counts = con.sql("SELECT video_id, count(text) FROM chosen GROUP BY 1 ORDER BY 1")
        with_text = {str(key): n for key, n in counts.fetchall()}
        # A part may be empty where there are fewer videos than machines.
        some = with_text or con.execute(f"FROM ({every}) LIMIT 1", values).fetchall()
        if not some and chosen.keyword:
            raise UsageError(f"no pair has the keyword {chosen.keyword!r}", hint=_near(run, chosen))
        if not some:
            raise UsageError("no pair meets the condition")
        if with_text and not any(with_text.values()):
            run.progress.say(
                "the pairs have no texts, as in every release, so their clips get no tokens:"
                " restore the release first"
            )
        found = find_films(folders, dict.fromkeys(with_text) | _lengths(con, catalog))
        reader = con.sql("FROM chosen").to_arrow_reader(_BATCH)  # in the order of their making
        yield Selection(found, list(with_text), by_video(reader))


def _lengths(con: DuckDBPyConnection, catalog: Catalog) -> dict[str, float | None]:
    """Of the chosen videos that the data describe, how long each is (s)."""
    videos = table_catalog.bare(catalog.views).get("youtube_videos")
    if videos is None:
        return {}
    with reading(videos.files):
        rows = con.execute(
            f"SELECT video_id, duration_s FROM {scan(videos.files)}"
            " WHERE video_id IN (SELECT video_id FROM chosen)"
        )
        return dict(rows.fetchall())


def _near(run: Run, chosen: Chosen) -> str:
    """Keywords that a misspelt one may mean, as a hint."""
    files = table_catalog.read_catalog(run.root).files("pairs/pairs")
    with reading(files), database.asking() as con:
        rows = con.execute(f"SELECT DISTINCT keyword FROM {scan(files)} ORDER BY 1").fetchall()
    near = similar(chosen.keyword, (str(name) for (name,) in rows))
    return f"did you mean {' or '.join(map(repr, near))}?" if near else ""


def cut_shard(
    folder: str, name: str, films: list[tuple[str, list[Row]]], options: CutOptions
) -> ShardReport:
    """Cut the clips of a shard's films, unless that was done. Runs in a worker. `films`: the path
    of each, and the rows of its pairs. A film that changes while it is read has no clips.
    """
    place = Path(folder)
    made_of = _digest(films, options)
    done = shard_report(place, name)
    if done is not None and done.made_of == made_of:
        return done
    left_out: list[LeftOut] = []
    while True:
        before = [version_of(path) for path, _ in films]
        clips: dict[str, int] = {}
        missed: list[LeftOut] = []
        with writer_of(options, place, name) as writer:
            for path, rows in films:
                missed += _cut_video(writer, Path(path), rows, options, clips)
        changed = [version_of(film[0]) != old for film, old in zip(films, before, strict=True)]
        if not any(changed):
            break
        left_out += [
            LeftOut(row["pair_id"], row["video_id"], UNDECODABLE, "the file changed meanwhile")
            for _, rows in compress(films, changed)
            for row in rows
        ]
        films = [film for film, other in zip(films, changed, strict=True) if not other]
        made_of = _digest(films, options)  # so that the next run cuts the others
    report = ShardReport(made_of, options, clips, left_out + missed)
    write_bytes(place / f"{name}.json", msgspec.json.encode(report))
    return report


def _cut_video(
    writer: Writer, path: Path, rows: list[Row], options: CutOptions, places: dict[str, int]
) -> list[LeftOut]:
    """Write the clips of a film and note their places; the pairs that have none."""
    times = [frame_times(row["clip_start_s"], row["clip_end_s"], options.frames) for row in rows]
    reason, what, left = SHORT, "the film has no picture for the whole clip", dict(enumerate(rows))
    try:
        for number, images in cut(path, times, options.size, options.fit):
            row = left.pop(number)
            places[row["pair_id"]] = writer.add(row, images, times[number])
    except UndecodableVideo as error:
        reason, what = UNDECODABLE, str(error)
    except FileNotFoundError:
        reason, what = MISSING, "the file is gone"
    return [LeftOut(row["pair_id"], row["video_id"], reason, what) for row in left.values()]


def version_of(path: str) -> tuple[int, int] | None:
    """Size and time of a file, which change when its content does; None when it is gone."""
    try:
        stat = Path(path).stat()
    except FileNotFoundError:
        return None
    return stat.st_size, stat.st_mtime_ns


def _digest(films: list[tuple[str, list[Row]]], options: CutOptions) -> str:
    """Of the films' content and the pairs, wherever the films lie."""
    cut_from = [(film_digest(Path(path)), rows) for path, rows in films]
    return hashlib.sha256(msgspec.json.encode((cut_from, options), order="sorted")).hexdigest()


def _write_left_out(place: Path, name: str, left_out: Sequence[LeftOut]) -> None:
    """Write them under the `name` of a part, or, without one, instead of those of all parts."""
    for path in place.glob("left_out-*-of-*.csv") if not name else ():
        path.unlink()
    text = io.StringIO()
    lines = csv.writer(text, lineterminator="\n")
    lines.writerow(LeftOut.__struct_fields__)
    ordered = sorted(left_out, key=lambda pair: (pair.video_id, pair.pair_id))
    lines.writerows(map(msgspec.structs.astuple, ordered))
    write_text(place / (name or "left_out.csv"), text.getvalue())
