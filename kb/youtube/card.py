"""What released videos lack, measured on them: sentences for card and datasheet."""

from collections.abc import Iterator

from duckdb import DuckDBPyConnection

from kb.artifacts.release_folder import ReleaseFolder
from kb.store.tables.reading import scan


def gaps(con: DuckDBPyConnection, folder: ReleaseFolder) -> Iterator[str]:
    """How views were counted."""
    if not (shards := folder.shards("videos")):
        return
    counts = dict(
        con.execute(
            f"SELECT view_rule::VARCHAR, count(*) FROM {scan(shards)} GROUP BY 1 ORDER BY 1"
        ).fetchall()
    )
    if not counts:
        return
    meanings = {
        "watch_time": "counted when they had been watched for some time",
        "playback_start": "counted when playback started",
    }
    parts = [f"those of {n:,} videos were {meanings[rule]}" for rule, n in counts.items()]
    mixed = "; the two are not comparable" if len(parts) > 1 else ""
    yield f"Views (`view_rule`): {', '.join(parts)}{mixed}."
