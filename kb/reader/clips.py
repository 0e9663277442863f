"""`data.clips(keyword)`: pairs with their videos and texts."""

import difflib
from typing import cast

from kb.artifacts.table_catalog import View
from kb.core.errors import UsageError
from kb.core.sources import made_of
from kb.reader.open_tables import OpenTables
from kb.reader.tables import QueryResult, TableView

_OF_VIDEO = ("title", "view_count", "like_count", "published_at")


def find(opened: OpenTables, keyword: str) -> QueryResult:
    """The clips of a keyword, in any case of its letters, in order of video and start.

    Columns: pair_id, keyword, keyword_kind, video_id, title and figures of the video, the clip's
    start and end (s), `url` that starts there, `text` (null where it was not restored),
    token_count, transcript_kind. Raises UsageError where there are no pairs or no such keyword.
    """
    ranked = opened.ranked("pairs")
    if not ranked:
        raise UsageError("the data contain no pairs", hint="load the folder of the pairs' release")
    pairs = ranked[0]
    clips = QueryResult(opened.rows(_sql(opened, pairs, ranked), [keyword]))
    if len(clips):
        return clips
    listed = opened.rows(f"SELECT DISTINCT keyword FROM {pairs.full}")["keyword"].to_pylist()
    known = cast("list[str]", listed)
    by_lower = {one.lower(): one for one in known}
    if keyword.lower() in by_lower:  # all of its clips have been removed
        return clips
    near = [by_lower[one] for one in difflib.get_close_matches(keyword.lower(), by_lower, 3)]
    raise UsageError(
        f"no clips of {keyword!r}." + (f" Did you mean {' or '.join(near)}?" if near else ""),
        hint='data.sql("SELECT DISTINCT keyword FROM pairs") lists the keywords',
    )


def _sql(opened: OpenTables, pairs: View, ranked: list[View]) -> str:
    joins, text = [], "NULL::VARCHAR"
    holding = [view for view in ranked if "text" in TableView(view).schema.names]
    if pairs in holding:
        text = "p.text"
    elif holding:
        joins.append(f"LEFT JOIN {holding[0].full} AS t USING (pair_id)")
        text = "t.text"
    videos = opened.ranked("youtube_videos")
    of_video = ", ".join(f"v.{name}" if videos else f"NULL AS {name}" for name in _OF_VIDEO)
    if videos:
        joins.append(f"LEFT JOIN {videos[0].full} AS v ON v.video_id = p.video_id")
    removed = [
        f"SELECT key FROM {one.full} WHERE source = '{source}'"
        for source in (*made_of("pairs"), "pairs")
        for one in opened.ranked(f"{source}_tombstones")
    ]
    left = f"AND p.video_id NOT IN ({' UNION ALL '.join(removed)})" if removed else ""
    return f"""
        SELECT p.pair_id, p.keyword, p.keyword_kind, p.video_id, {of_video},
            p.clip_start_s, p.clip_end_s,
            'https://www.youtube.com/watch?v=' || p.video_id
                || '&t=' || floor(p.clip_start_s)::BIGINT || 's' AS url,
            {text} AS text, p.token_count, p.transcript_kind
        FROM {pairs.full} AS p {" ".join(joins)}
        WHERE lower(p.keyword) = lower(?) {left}
        ORDER BY p.video_id, p.clip_start_s, p.pair_id"""
