"""What released videos lack, measured on them: sentences for card and datasheet."""

from collections.abc import Iterator
from pathlib import Path

from duckdb import DuckDBPyConnection

from kb.artifacts.release_folder import ReleaseFolder
from kb.store.layout import Layout
from kb.store.tables.reading import scan


def gaps(con: DuckDBPyConnection, root: Path, folder: ReleaseFolder) -> Iterator[str]:
    """How views were counted, and of how many videos it is unknown whether they are public."""
    yield from _views(con, folder)
    yield from _unknown_availability(con, root)


def _unknown_availability(con: DuckDBPyConnection, root: Path) -> Iterator[str]:
    if not (files := Layout(root).rows("youtube/videos")):
        return
    videos, unknown = con.execute(
        f"SELECT count(*), count(*) FILTER (availability IS DISTINCT FROM 'public')"
        f" FROM {scan(files)}"
    ).fetchone() or (0, 0)
    if unknown:
        yield (
            f"Of {unknown:,} of {videos:,} videos nothing says who may see them; they count as"
            " public."
        )


def _views(con: DuckDBPyConnection, folder: ReleaseFolder) -> Iterator[str]:
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
