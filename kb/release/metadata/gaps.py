"""What a release lacks of what it is about, measured on its own rows:
sentences for card and datasheet.
"""

from duckdb import DuckDBPyConnection

from kb.artifacts.release_folder import ReleaseFolder
from kb.core.source_spec import load_name
from kb.core.sources import RELEASES
from kb.store.tables.reading import scan

# The longest chain of comments that can be walked from a post, each by its parent.
_WALK = """
    WITH RECURSIVE walk(name, steps) AS (
        SELECT 't1_' || comment_id, 0 FROM {c} WHERE starts_with(parent_id, 't3_')
        UNION ALL
        SELECT 't1_' || comment_id, steps + 1 FROM {c} JOIN walk ON parent_id = walk.name
    )
    SELECT max(steps) FROM walk"""


def gaps(con: DuckDBPyConnection, folder: ReleaseFolder) -> tuple[str, ...]:
    """One sentence a gap, of tables that say of themselves what is not in them."""
    checks = map(load_name, RELEASES[folder.source].gaps)
    return tuple(sentence for check in checks if (sentence := check(con, folder)))


def views(con: DuckDBPyConnection, folder: ReleaseFolder) -> str:
    """How views were counted."""
    scan = _scan(folder, "videos")
    if not scan:
        return ""
    counts = dict(
        con.execute(
            f"SELECT view_rule::VARCHAR, count(*) FROM {scan} GROUP BY 1 ORDER BY 1"
        ).fetchall()
    )
    if not counts:
        return ""
    meanings = {
        "watch_time": "counted when they had been watched for some time",
        "playback_start": "counted when playback started",
    }
    parts = [f"those of {n:,} videos were {meanings[rule]}" for rule, n in counts.items()]
    mixed = "; the two are not comparable" if len(parts) > 1 else ""
    return f"Views (`view_rule`): {', '.join(parts)}{mixed}."


_PILLOW_LIMIT = 178_956_970  # pixels: twice Image.MAX_IMAGE_PIXELS, above which Pillow refuses


def large_screenshots(con: DuckDBPyConnection, folder: ReleaseFolder) -> str:
    """Screenshots that Pillow does not open by default."""
    scan = _scan(folder, "pages")
    if not scan:
        return ""
    pixels = "page_width * page_height * device_pixel_ratio * device_pixel_ratio"
    ((large,),) = con.execute(
        f"SELECT count(*) FROM {scan} WHERE {pixels} > {_PILLOW_LIMIT}"
    ).fetchall()
    if not large:
        return ""
    return (
        f"{large:,} {'screenshot has' if large == 1 else 'screenshots have'} more than"
        f" {_PILLOW_LIMIT / 1e6:.1f} megapixels, which Pillow refuses to open until"
        " `PIL.Image.MAX_IMAGE_PIXELS = None` is set; `kb.load` opens them."
    )


def threads(con: DuckDBPyConnection, folder: ReleaseFolder) -> str:
    """Comments whose parent was left out."""
    scan = _scan(folder, "comments")
    if not scan:
        return ""
    total, cut, deepest = con.execute(
        f"SELECT count(*), count(*) FILTER (NOT parent_in_release), max(depth) FROM {scan}"
    ).fetchone() or (0, 0, None)
    if not cut:
        return ""
    walked = (con.execute(_WALK.format(c=scan)).fetchone() or (None,))[0]
    return (
        f"Threads have gaps: {cut:,} of {total:,} comments answer one that was left out,"
        " because it was deleted, removed, dropped by a filter or not to be had"
        " (`parent_in_release` is false). `depth` is the true one: the deepest comment is at"
        f" {_at(deepest)}, the deepest that can be reached from its post along `parent_id`"
        f" at {_at(walked)}."
    )


def unread(con: DuckDBPyConnection, folder: ReleaseFolder) -> str:
    """Comments that were never read."""
    scan = _scan(folder, "posts")
    if not scan:
        return ""
    posts, unread = con.execute(
        f"SELECT count(*), sum(comments_unread) FROM {scan} WHERE comments_unread > 0"
    ).fetchone() or (0, 0)
    if not posts:
        return ""
    return (
        f"{unread:,} comments of {posts:,} posts are known to exist and were not read,"
        " because the source did not answer or was not asked for them (`comments_unread`)."
    )


def _scan(folder: ReleaseFolder, short: str) -> str:
    shards = [shard for part in folder.parts if part.table.short == short for shard in part.shards]
    return scan(shards) if shards else ""


def _at(depth: int | None) -> str:
    return "none" if depth is None else f"{depth:,}"
