"""Newest answers about videos and transcripts → the rows that the stages judge.

First all answers about a video are joined into one row:

    videos        videos.list: everything that the Data API has
    statistics    videos.batchGetStats: the counts, read again
    ytdlp_info    an imported file of yt-dlp

A value is the newest answer's, or where that has none the other's: an import replaces nothing
by null. The counts and `counted_at` are of one answer, the newest that has views; `fetched_at` says
how old all the rest is. Only videos.list says that a video is missing: no file brings back what the
service has removed.

Word times of automatic tracks are checked: one start for each word of a cue, in order. A cue whose
starts do not fit loses them and keeps its text; the column `word_times` says why.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator
from pathlib import Path
from typing import Any, Literal, cast

import pyarrow as pa

from kb.core.installation import np, pc
from kb.schema.tables import table
from kb.store.layout import Layout
from kb.store.rawlog import rawlog
from kb.store.tables import reading
from kb.store.tables.columns import aligned, column, lists, newest, put, sums, where
from kb.store.tables.partition import RawKind
from kb.youtube.parse import answers as parse
from kb.youtube.parse.view_counting import view_rule
from kb.youtube.ytdlp import info, tracks
from kb.youtube.ytdlp.tracks import ENGLISH, TrackLanguage, language_of

COMPLETE, ABSENT = "complete", "absent"
MISMATCH, NEGATIVE, UNORDERED = "mismatch", "negative", "unordered"


def checked(
    cues: pa.Array[Any], automatic: pa.Array[Any], words: pa.Array[Any]
) -> tuple[pa.Array[Any], pa.Array[Any]]:
    """The starts of the words of each cue (list of float64; null where the cue has none that can
    be used), and `word_times` of each track.

    `cues`: lists of structs with `word_start_s`; `automatic`: which tracks may have word times;
    `words` (int64): the number of words of each cue, all tracks together.
    """
    starts = pc.list_flatten(cues).field("word_start_s")
    track = pc.list_parent_indices(cues).to_numpy()
    sizes = pc.fill_null(pc.list_value_length(starts), -1).to_numpy()
    times, ends = pc.list_flatten(starts).to_numpy(), np.cumsum(np.maximum(sizes, 0))
    falls = np.flatnonzero(times[1:] < times[:-1]) + 1
    unordered = np.searchsorted(ends, falls, "right")
    unordered = unordered[unordered == np.searchsorted(ends, falls - 1, "right")]
    negative = np.searchsorted(ends, np.flatnonzero(~(np.isfinite(times) & (times >= 0))), "right")
    reason = np.zeros(len(starts), np.int8)
    reason[unordered], reason[negative] = 1, 2
    said = words.to_numpy()
    reason[(sizes >= 0) & (sizes != said)] = 3
    reason[~automatic.to_numpy(zero_copy_only=False)[track] | (sizes < 0)] = 4
    if ((reason > 0) & (sizes >= 0)).any():
        starts = pc.if_else(pa.array(reason == 0), starts, pa.scalar(None, starts.type))
    # A track's reason is that of its first cue with words and without word times.
    lacking = np.flatnonzero((reason > 0) & (said > 0))
    tracks, first = np.unique(track[lacking], return_index=True)
    verdict = np.zeros(len(cues), np.int8)
    verdict[tracks] = reason[lacking[first]]
    return starts, pa.array([COMPLETE, UNORDERED, NEGATIVE, MISMATCH, ABSENT]).take(
        pa.array(verdict)
    )


FROM_FILE = "from_file"  # true for a video that only an imported file tells of
IMPORTED = "imported"  # true for a video that an imported file tells of
COUNTED = ("view_count", "like_count", "comment_count")
_OF_ONE = (*COUNTED, "counted_at")


def one_row_each(
    videos: pa.Table | None, files: pa.Table | None, statistics: pa.Table | None
) -> pa.Table | None:
    """The rows of `videos` and `files` (newest of each `video_id`) joined, by `video_id`.

    Both have the columns of `answers.videos`, `files` also those that only a file has. Statistics
    of other videos are left out. None where there is no video at all.
    """
    if files is None:
        rows = videos
    elif videos is None:
        always = pa.repeat(pa.scalar(True), files.num_rows)
        rows = files.append_column(FROM_FILE, always).append_column(IMPORTED, always)
    else:
        rows = _api_and_file(videos, files)
    if rows is None:
        return None
    return _stamped(rows) if statistics is None else with_statistics(rows, statistics)


def with_statistics(rows: pa.Table, statistics: pa.Table) -> pa.Table:
    """The rows with the counts of `statistics` where these are newer and have views."""
    rows = _stamped(rows)
    if not statistics.num_rows:
        return rows
    fresh = aligned(_stamped(statistics), "video_id", column(rows, "video_id"))
    newer = _newer(fresh, rows)
    for name in _OF_ONE:
        rows = put(rows, name, pc.if_else(newer, column(fresh, name), column(rows, name)))
    return rows


def _api_and_file(videos: pa.Table, files: pa.Table) -> pa.Table:
    keys = pc.unique(pa.concat_arrays([column(videos, "video_id"), column(files, "video_id")]))
    keys = keys.take(pc.sort_indices(keys))
    api, file = (aligned(_stamped(one), "video_id", keys) for one in (videos, files))
    newest_first = pc.or_(pc.is_null(column(api, "fetched_at")), _is_after(file, api, "fetched_at"))
    made: dict[str, Any] = {}
    for name in dict.fromkeys([*api.column_names, *file.column_names]):
        if name not in api.column_names or name not in file.column_names:
            made[name] = column(api if name in api.column_names else file, name)
            continue
        a, f = column(api, name), column(file, name)
        made[name] = pc.coalesce(pc.if_else(newest_first, f, a), pc.if_else(newest_first, a, f))
    missing = pc.fill_null(column(api, "missing"), False)
    made["availability"] = _availability(made["availability"], column(file, "availability"))
    rows = pa.table({**made, "video_id": keys, "missing": missing})
    rows = rows.append_column(FROM_FILE, pc.is_null(column(api, "fetched_at")))
    rows = rows.append_column(IMPORTED, pc.is_in(keys, value_set=column(files, "video_id")))
    counted = pc.or_(_newer(file, api), pc.is_null(column(api, "view_count")))
    has_views = pc.or_(*(pc.is_valid(column(side, "view_count")) for side in (file, api)))
    for name in _OF_ONE:
        either = pc.if_else(counted, column(file, name), column(api, name))
        rows = put(rows, name, pc.if_else(has_views, either, column(rows, name)))
    return rows


# Words that only yt-dlp has: the API calls such a video public.
_FOR_SOME = ("needs_auth", "premium_only", "subscriber_only")


def _availability(newest: Any, file: pa.Array[Any]) -> Any:
    """Who may see each video: what the newest answer says, but for what the API can't know."""
    return pc.if_else(pc.is_in(file, value_set=pa.array(_FOR_SOME, file.type)), file, newest)


def _newer(one: pa.Table, other: pa.Table) -> pa.Array[Any]:
    """Where `one` has views, and is the newer or the other has none."""
    views = pc.is_valid(column(one, "view_count"))
    alone = pc.is_null(column(other, "view_count"))
    return pc.and_(views, pc.or_(alone, _is_after(one, other, "counted_at")))


def _is_after(one: pa.Table, other: pa.Table, when: str) -> pa.Array[Any]:
    return pc.fill_null(pc.greater(column(one, when), column(other, when)), False)


def _stamped(rows: pa.Table) -> pa.Table:
    """The rows with `counted_at`: an answer's counts are as old as the answer."""
    if "counted_at" in rows.column_names:
        return rows
    return rows.append_column("counted_at", column(rows, "fetched_at"))


VIDEOS = "videos"  # kind in the frontier
HELPERS = ("missing", "game_label_id", "game_label", "transcript_outcome", IMPORTED)
KINDS = {
    "videos": RawKind(parse.videos, key=("video_id",), bucket="video_id"),
    "statistics": RawKind(parse.statistics, key=("video_id",), bucket="video_id"),
    "ytdlp_info": RawKind(info.rows, key=("video_id",), bucket="video_id"),
    "ytdlp_subtitles": RawKind(tracks.rows, key=("video_id", "track", "format"), bucket="video_id"),
    "own_transcripts": RawKind(tracks.rows, key=("video_id", "track", "format"), bucket="video_id"),
    "transcripts": RawKind(
        parse.transcripts, key=("video_id",), bucket="video_id", by=("final", "fetched_at")
    ),
}
WATCH = "https://www.youtube.com/watch?v="


def assemble(
    latest: dict[str, pa.Table],
    words: Callable[[Any], pa.Array[Any]],
    language: TrackLanguage = ENGLISH,
    own: Literal["fill", "prefer", "ignore"] = "fill",
) -> dict[str, pa.Table]:
    """Videos joined with what is known of their transcripts, and the outcome of each transcript,
    of which `with_tracks` makes the table.

    `words` counts the words of each text; `language` chooses among imported tracks; `own` says
    whether own transcripts stand where YouTube has none, before YouTube's, or nowhere.
    Adds to the parsed columns: `link`, `imported` (whether a file tells of it), `width`, `height`
    (px; the largest stream's when known, else the embed frame's), `fps`, `view_rule`,
    `metadata_origin`, `age_restricted`, `game_label_id`, `game_label`, `transcript_outcome` (null:
    not asked), `transcript_kind`, `transcript_origin`, `word_count`.
    """
    videos = one_row_each(latest.get("videos"), latest.get("ytdlp_info"), latest.get("statistics"))
    outcomes = tracks.with_imported(
        latest.get("transcripts"),
        latest.get("ytdlp_subtitles"),
        latest.get("ytdlp_info"),
        language,
    )
    if outcomes is not None and videos is not None:
        outcomes = tracks.without_dubs(outcomes, videos, language)
    transcripts = _with_own(
        _usable(outcomes, words),
        tracks.own(latest.get("own_transcripts") if own != "ignore" else None, language),
        words,
        before=own == "prefer",
    )
    if videos is None:
        return {"youtube/transcripts": transcripts}
    return {"youtube/videos": _joined(videos, transcripts), "youtube/transcripts": transcripts}


def unanswered(root: Path) -> Iterator[tuple[str, str]]:
    """Videos whose metadata could not be had after all tries, with the reason: (key, reason)."""
    path = Layout(root).state("youtube")
    if not path.exists():
        return
    with reading.state(path) as frontier:
        for key, _, reason, _ in frontier.items(VIDEOS, "error", "skipped"):
            yield key, reason or "failed"


def _joined(videos: pa.Table, transcripts: pa.Table) -> pa.Table:
    own = [name for name in transcripts.column_names if name not in ("cues", "cue_words")]
    side = aligned(transcripts.select(own), "video_id", column(videos, "video_id"))
    outcome = column(side, "outcome")
    from_file: Any = pa.scalar(False)
    if FROM_FILE in videos.column_names:
        # Nobody will read the label of a video that only a file tells of: keywords decide.
        from_file = column(videos, FROM_FILE)
        outcome = pc.if_else(pc.and_(from_file, pc.is_null(outcome)), tracks.NOT_IMPORTED, outcome)
        videos = videos.drop_columns([FROM_FILE])
    else:
        nowhere = pa.repeat(pa.scalar(False), videos.num_rows)
        videos = videos.append_column(IMPORTED, nowhere)
    width, height, fps = _size(videos, side)
    had = pc.fill_null(pc.equal(outcome, "ok"), False)
    not_imported = pc.fill_null(pc.equal(outcome, tracks.NOT_IMPORTED), False)
    final = pc.and_not(parse.is_final(outcome), not_imported)
    kind = pc.if_else(had, column(side, "kind"), pc.if_else(final, "none", "unknown"))
    restricted = pc.or_(
        pc.equal(pc.fill_null(column(videos, "yt_rating"), ""), "ytAgeRestricted"),
        pc.equal(pc.fill_null(outcome, ""), "age_restricted"),
    )
    made: dict[str, Any] = {
        "link": pc.binary_join_element_wise(WATCH, column(videos, "video_id"), ""),
        "width": width,
        "height": height,
        "fps": fps,
        "age_restricted": restricted,
        "game_label_id": column(side, "game_label_id"),
        "game_label": column(side, "game_label"),
        "transcript_outcome": outcome,
        "transcript_kind": kind,
        "transcript_origin": pc.if_else(had, column(side, "origin"), pa.scalar(None, pa.string())),
        "word_count": pc.if_else(had, column(side, "word_count"), pa.scalar(None, pa.int64())),
        "problems": _renamed(column(videos, "problems")),
    }
    made["metadata_origin"] = pc.if_else(from_file, "file", pa.array(["api"] * videos.num_rows))
    for name, values in made.items():
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
    """Outcomes with a readable video id, `cue_words` (words of each cue) and `word_count`.

    An `ok` whose kind, language or cues can't be read counts as failed, one without a word as none.
    """
    if rows is None:
        names = table("youtube/transcripts")
        fields = [(each.name, each.parsed.arrow()) for each in (*names.columns, *names.inputs)]
        fields += [("cue_words", pa.list_(pa.int64())), ("word_count", pa.int64())]
        return pa.schema(fields).empty_table()
    rows = where(rows, pc.is_valid(rows["video_id"]))
    complete = pc.and_(
        pc.and_(pc.is_valid(rows["cues"]), pc.is_valid(rows["kind"])),
        pc.is_valid(rows["language"]),
    )
    broken = pc.and_(pc.equal(rows["outcome"], "ok"), pc.invert(complete))
    cues = column(rows, "cues")
    of_cues = lists(pc.list_value_length(cues), words(pc.list_flatten(cues).field("text")))
    counted = sums(of_cues)
    empty = pc.and_(pc.equal(rows["outcome"], "ok"), pc.fill_null(pc.equal(counted, 0), False))
    outcome = pc.if_else(broken, "failed", pc.if_else(empty, "none", rows["outcome"]))
    rows = put(rows, "outcome", pc.fill_null(outcome, "failed"))
    return rows.append_column("cue_words", of_cues).append_column("word_count", counted)


def _with_own(
    service: pa.Table, own: pa.Table | None, words: Callable[[Any], pa.Array[Any]], *, before: bool
) -> pa.Table:
    """Usable outcomes and those of own transcripts, which take the place of what YouTube has no
    text for, `before` of all but what its page restricts by age; `origin` says whose each is. What
    else the page says stays.
    """
    service = service.append_column("origin", pa.repeat(pa.scalar("service"), service.num_rows))
    if own is None:
        return service
    own = _usable(own, words)
    own = own.filter(pc.equal(own["outcome"], "ok"))
    kept = pa.array(["age_restricted"] if before else ["ok", "age_restricted"])
    stays = service.filter(pc.is_in(service["outcome"], value_set=kept))["video_id"]
    own = own.filter(pc.invert(pc.is_in(own["video_id"], value_set=stays.combine_chunks())))
    page = aligned(service, "video_id", column(own, "video_id"))
    for name in tracks.FACTS:
        own = put(own, name, column(page, name))
    whose = pa.repeat(pa.scalar("own"), own.num_rows)
    own = put(own.append_column("origin", whose), tracks.READ_FROM, whose)
    replaced = pc.is_in(service["video_id"], value_set=column(own, "video_id"))
    both = [name for name in service.column_names if name in own.column_names]
    return pa.concat_tables([service.filter(pc.invert(replaced)).select(both), own.select(both)])


def with_tracks(kept: dict[str, pa.Table]) -> dict[str, pa.Table]:
    """Kept videos, and of their outcomes the tracks that were had. Cues of automatic ones end where
    the next one starts, and their word times are checked.
    """
    if (outcomes := kept.get("youtube/transcripts")) is None:
        return kept
    transcripts = where(outcomes, pc.equal(outcomes["outcome"], "ok"))
    cues = column(transcripts, "cues")
    flat = pc.list_flatten(cues)
    original = pc.fill_null(pc.equal(column(transcripts, "original_kind"), "asr"), False)
    automatic = pc.fill_null(pc.equal(column(transcripts, "kind"), "asr"), False)
    words = pc.list_flatten(column(transcripts, "cue_words"))
    starts, verdict = checked(cues, automatic, words)
    begin, length = _stretched(cues, flat.field("start_s"), _lengths(cues, flat, original), starts)
    fields = [begin, length, flat.field("text"), starts]
    names = ["start_s", "duration_s", "text", "word_start_s"]
    made = pa.StructArray.from_arrays(fields, names=names)
    given = column(transcripts, "language")
    languages = [one and language_of(one) for one in given.to_pylist()]
    own = {
        "language": pa.array(languages, given.type),
        "cues": lists(pc.list_value_length(cues), made),
        "word_times": pc.if_else(automatic, verdict, pa.scalar(None, pa.string())),
    }
    columns = {name: column(transcripts, name) for name in transcripts.column_names} | own
    tracks = pa.table({name: columns[name] for name in table("youtube/transcripts").names()})
    return {**kept, "youtube/transcripts": tracks}


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


def _stretched(
    cues: pa.Array[Any], start: pa.Array[Any], length: pa.Array[Any], words: pa.Array[Any]
) -> tuple[pa.Array[Any], pa.Array[Any]]:
    """Start and length (s) of cues that hold all their words (which are in order), the last one
    until the next cue begins but at most a second.
    """
    times, sizes = pc.list_flatten(words), pc.fill_null(pc.list_value_length(words), 0)
    ends = pc.cumulative_sum(sizes.cast(pa.int64()))
    some = pc.greater(sizes, 0)
    first = times.take(pc.if_else(some, pc.subtract(ends, sizes), pa.scalar(None, pa.int64())))
    last = times.take(pc.if_else(some, pc.subtract(ends, 1), pa.scalar(None, pa.int64())))
    track = pc.list_parent_indices(cues)
    same = pc.equal(track.slice(1), track.slice(0, max(len(track) - 1, 0)))
    nothing = pa.scalar(None, start.type)
    following = pa.concat_arrays(
        [pc.if_else(same, start.slice(1), nothing), pa.nulls(min(len(start), 1), start.type)]
    )
    until = pc.add(last, 1)
    is_later = pc.fill_null(pc.greater(following, last), False)
    until = pc.if_else(is_later, pc.min_element_wise(until, following), until)
    end = pc.add(start, length)
    late = pc.fill_null(pc.greater_equal(last, end), False)
    early = pc.fill_null(pc.less(first, start), False)
    begin = pc.if_else(early, first, start)
    stretched = pc.round(pc.subtract(pc.if_else(late, until, end), begin), 3)
    return begin, pc.if_else(pc.or_(late, early), stretched, length)


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

    `words` counts the words of each text. Columns: those of youtube/transcripts; word
    times are checked. Raises DamagedData.
    """
    left = pa.array(sorted(ids), pa.string())
    for path in rawlog.segments(root, "youtube", "second_tracks"):
        for rows in parse.transcripts(line for _, line in rawlog.Frames(path)):
            tracks = with_tracks(assemble({"transcripts": rows}, words))["youtube/transcripts"]
            tracks = tracks.filter(pc.is_in(tracks["video_id"], value_set=left))
            yield newest(tracks, ("video_id",), ())
            read = tracks["video_id"].combine_chunks()
            left = left.filter(pc.invert(pc.is_in(left, value_set=read)))
