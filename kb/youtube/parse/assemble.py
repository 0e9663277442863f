"""Newest answers about videos and transcripts → the rows that the stages judge."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator
from pathlib import Path
from typing import Any, cast

import pyarrow as pa
import pyarrow.compute as pc

from kb.schema.tables import table
from kb.store.layout import Layout
from kb.store.rawlog import rawlog
from kb.store.tables import reading
from kb.store.tables.columns import aligned, column, lists, put
from kb.store.tables.latest import newest
from kb.store.tables.partition import RawKind
from kb.youtube.parse import answers as parse
from kb.youtube.parse.join import FROM_FILE, one_row_each
from kb.youtube.parse.view_counting import view_rule
from kb.youtube.parse.word_times import checked
from kb.youtube.ytdlp import info, tracks
from kb.youtube.ytdlp.tracks import ENGLISH, TrackLanguage

VIDEOS = "videos"  # kind in the frontier
HELPERS = ("missing", "game_label_id", "game_label", "transcript_outcome")
KINDS = {
    "videos": RawKind(parse.videos, key=("video_id",), bucket="video_id"),
    "statistics": RawKind(parse.statistics, key=("video_id",), bucket="video_id"),
    "ytdlp_info": RawKind(info.rows, key=("video_id",), bucket="video_id"),
    "ytdlp_subtitles": RawKind(tracks.rows, key=("video_id", "track", "format"), bucket="video_id"),
    "transcripts": RawKind(
        parse.transcripts, key=("video_id",), bucket="video_id", by=("final", "fetched_at")
    ),
}
WATCH = "https://www.youtube.com/watch?v="


def assemble(
    latest: dict[str, pa.Table],
    words: Callable[[Any], pa.Array[Any]],
    language: TrackLanguage = ENGLISH,
) -> dict[str, pa.Table]:
    """Videos joined with what is known of their transcripts, and the transcripts that were had.

    `words` counts the words of each list of texts; `language` chooses among imported tracks.
    Adds to the parsed columns: `link`, `width`, `height` (px; the largest stream's when known, else
    the embed frame's), `fps`, `view_rule`, `metadata_origin`, `age_restricted`,
    `game_label_id`, `game_label`, `transcript_outcome` (null: not asked), `transcript_kind`,
    `word_count`.
    """
    videos = one_row_each(latest.get("videos"), latest.get("ytdlp_info"), latest.get("statistics"))
    outcomes = tracks.with_imported(
        latest.get("transcripts"),
        latest.get("ytdlp_subtitles"),
        latest.get("ytdlp_info"),
        language,
    )
    transcripts = _usable(outcomes, words)
    if videos is None:
        return {"youtube/transcripts": _tracks(transcripts, words)}
    return {
        "youtube/videos": _joined(videos, transcripts),
        "youtube/transcripts": _tracks(transcripts, words),
    }


def unanswered(root: Path) -> Iterator[tuple[str, str]]:
    """Videos whose metadata could not be had after all tries, with the reason: (key, reason)."""
    path = Layout(root).state("youtube")
    if not path.exists():
        return
    with reading.state(path) as frontier:
        for key, _, reason, _ in frontier.items(VIDEOS, "error", "skipped"):
            yield key, reason or "failed"


def _joined(videos: pa.Table, transcripts: pa.Table) -> pa.Table:
    side = aligned(transcripts, "video_id", column(videos, "video_id"))
    outcome = column(side, "outcome")
    from_file: Any = pa.scalar(False)
    if FROM_FILE in videos.column_names:
        # Nobody will read the label of a video that only a file tells of: keywords decide.
        from_file = column(videos, FROM_FILE)
        outcome = pc.if_else(pc.and_(from_file, pc.is_null(outcome)), tracks.NOT_IMPORTED, outcome)
        videos = videos.drop_columns([FROM_FILE])
    width, height, fps = _size(videos, side)
    had = pc.fill_null(pc.equal(outcome, "ok"), False)
    not_imported = pc.fill_null(pc.equal(outcome, tracks.NOT_IMPORTED), False)
    final = pc.and_not(parse.is_final(outcome), not_imported)
    kind = pc.if_else(had, column(side, "kind"), pc.if_else(final, "none", "unknown"))
    restricted = pc.or_(
        pc.equal(pc.fill_null(column(videos, "yt_rating"), ""), "ytAgeRestricted"),
        pc.equal(pc.fill_null(outcome, ""), "age_restricted"),
    )
    own: dict[str, Any] = {
        "link": pc.binary_join_element_wise(WATCH, column(videos, "video_id"), ""),
        "width": width,
        "height": height,
        "fps": fps,
        "age_restricted": restricted,
        "game_label_id": column(side, "game_label_id"),
        "game_label": column(side, "game_label"),
        "transcript_outcome": outcome,
        "transcript_kind": kind,
        "word_count": pc.if_else(had, column(side, "word_count"), pa.scalar(None, pa.int64())),
        "problems": _renamed(column(videos, "problems")),
    }
    own["metadata_origin"] = pc.if_else(from_file, "file", pa.array(["api"] * videos.num_rows))
    for name, values in own.items():
        videos = put(videos, name, values)
    return videos.append_column("view_rule", view_rule(videos))


def _size(videos: pa.Table, side: pa.Table) -> tuple[Any, Any, Any]:
    """Width and height in px, from one place, and the frame rate: of the watch page's largest
    stream, else of an imported file's, else the embed frame's, which has no rate.
    """
    width, height = column(videos, "embed_width"), column(videos, "embed_height")
    fps: Any = pa.nulls(videos.num_rows, pa.int64())
    for rows, prefix in ((videos, "stream"), (side, "player")):
        if f"{prefix}_width" not in rows.column_names:
            continue
        own = [column(rows, f"{prefix}_{name}") for name in ("width", "height", "fps")]
        sized = pc.and_(pc.is_valid(own[0]), pc.is_valid(own[1]))
        width, height = pc.if_else(sized, own[0], width), pc.if_else(sized, own[1], height)
        fps = pc.coalesce(own[2], fps)
    return width, height, fps


def _usable(rows: pa.Table | None, words: Callable[[Any], pa.Array[Any]]) -> pa.Table:
    """Outcomes with a readable video id, and `word_count`.

    An `ok` whose kind, language or cues can't be read counts as failed, one without a word as none.
    """
    if rows is None:
        names = table("youtube/transcripts")
        fields = [(each.name, each.parsed.arrow()) for each in (*names.columns, *names.inputs)]
        return pa.schema([*fields, ("word_count", pa.int64())]).empty_table()
    rows = rows.filter(pc.is_valid(rows["video_id"]))
    complete = pc.and_(
        pc.and_(pc.is_valid(rows["cues"]), pc.is_valid(rows["kind"])),
        pc.is_valid(rows["language"]),
    )
    broken = pc.and_(pc.equal(rows["outcome"], "ok"), pc.invert(complete))
    cues = column(rows, "cues")
    counted = words(lists(pc.list_value_length(cues), pc.list_flatten(cues).field("text")))
    empty = pc.and_(pc.equal(rows["outcome"], "ok"), pc.fill_null(pc.equal(counted, 0), False))
    outcome = pc.if_else(broken, "failed", pc.if_else(empty, "none", rows["outcome"]))
    rows = put(rows, "outcome", pc.fill_null(outcome, "failed"))
    return rows.append_column("word_count", counted)


def _tracks(transcripts: pa.Table, words: Callable[[Any], pa.Array[Any]]) -> pa.Table:
    """Tracks that were had. Cues of automatic ones end where the next one starts, and their word
    times are checked.
    """
    transcripts = transcripts.filter(pc.equal(transcripts["outcome"], "ok"))
    cues = column(transcripts, "cues")
    flat = pc.list_flatten(cues)
    original = pc.fill_null(pc.equal(column(transcripts, "original_kind"), "asr"), False)
    automatic = pc.fill_null(pc.equal(column(transcripts, "kind"), "asr"), False)
    one_each = lists(pa.repeat(pa.scalar(1), len(flat)), flat.field("text"))
    starts, verdict = checked(cues, automatic, words(one_each))
    fields = [flat.field("start_s"), _lengths(cues, flat, original), flat.field("text"), starts]
    names = ["start_s", "duration_s", "text", "word_start_s"]
    made = pa.StructArray.from_arrays(fields, names=names)
    own = {
        "cues": lists(pc.list_value_length(cues), made),
        "word_times": pc.if_else(automatic, verdict, pa.scalar(None, pa.string())),
    }
    columns = {name: column(transcripts, name) for name in transcripts.column_names} | own
    return pa.table({name: columns[name] for name in table("youtube/transcripts").names()})


def _lengths(cues: pa.Array[Any], flat: Any, automatic: pa.Array[Any]) -> pa.Array[Any]:
    """The length of each cue (s); in automatic tracks a cue ends where the next one starts, as it
    is shown on while that is spoken.
    """
    start, length = flat.field("start_s"), flat.field("duration_s")
    if len(flat) < 2:
        return cast("pa.Array[Any]", length)
    track = pc.list_parent_indices(cues)
    gap = pc.round(pc.subtract(start.slice(1), start.slice(0, len(start) - 1)), 3)
    within = pc.and_(
        pc.equal(track.slice(1), track.slice(0, len(track) - 1)), automatic.take(track.slice(1))
    )
    before_last = pc.if_else(
        pc.and_(within, pc.greater_equal(gap, 0)),
        pc.min_element_wise(gap, length.slice(0, len(length) - 1)),
        length.slice(0, len(length) - 1),
    )
    return pa.concat_arrays([before_last, length.slice(len(length) - 1)])


def _renamed(problems: pa.Array[Any]) -> pa.Array[Any]:
    """What could not be read as embed_width was needed as width."""
    flat = pc.list_flatten(problems)
    if not len(flat):
        return problems
    name = pc.replace_substring_regex(flat.field("column"), "^embed_", "")
    renamed = pa.StructArray.from_arrays(
        [name, flat.field("reason"), flat.field("value")], names=["column", "reason", "value"]
    )
    return lists(pc.list_value_length(problems), renamed)


def second_tracks(
    root: Path, ids: Collection[str], words: Callable[[Any], pa.Array[Any]]
) -> Iterator[pa.Table]:
    """The tracks that were fetched of these videos, at most one each, some hundred at a time.

    `words` counts the words of each list of texts. Columns: those of youtube/transcripts; word
    times are checked. Raises DamagedData.
    """
    left = pa.array(sorted(ids), pa.string())
    for path in rawlog.segments(root, "youtube", "second_tracks"):
        for rows in parse.transcripts(line for _, line in rawlog.Frames(path)):
            tracks = assemble({"transcripts": rows}, words)["youtube/transcripts"]
            tracks = tracks.filter(pc.is_in(tracks["video_id"], value_set=left))
            yield newest(tracks, ("video_id",), ())
            found = tracks["video_id"].combine_chunks()
            left = left.filter(pc.invert(pc.is_in(left, value_set=found)))
