"""What `kb status` says about YouTube: quota units, the buckets of the day, captions kept back; and
which videos have no transcript.
"""

from pathlib import Path
from typing import Any

from kb.artifacts import manifest
from kb.core import clock
from kb.core.context import Run
from kb.core.errors import FatalError
from kb.schema.coerce import inner
from kb.store.layout import Layout, parquet_files
from kb.store.rawlog import rawlog
from kb.store.state.frontier import Frontier
from kb.store.tables import database, parquet
from kb.store.tables.reading import reading, scan
from kb.youtube.crawl.quota import BUCKETS, quota
from kb.youtube.crawl.reduce import RAW_INFO, RAW_STATISTICS, RAW_VIDEOS, with_po_token
from kb.youtube.section import YouTubeSection


def status(run: Run, frontier: Frontier) -> dict[str, Any]:
    """Units spent in all, what is left of today's buckets, and videos that need a PO token."""
    _, units = frontier.requests()
    buckets: dict[str, Any] = {}
    if (section := run.profile.section_if_any(YouTubeSection)) is not None:
        for asked in (quota(section, bucket) for bucket in BUCKETS):
            spent, limit = asked.used(frontier), asked.per_day
            left, resets_at = max(0, limit - spent), clock.stamp(asked.reset())
            row = {"spent": spent, "left": left, "limit": limit, "resets_at": resets_at}
            buckets[asked.bucket] = row
    return {"units": units, "quota": buckets, "po_token": with_po_token(frontier)}


_FOLDER = "clean/youtube"
# By table, which of its rows have passed the stages before that of the transcript.
_WITHOUT = {
    "videos": ("video_id", "transcript_kind IN ('none', 'unknown')"),
    "rejected": ("key", "stage = 'transcript'"),
    "failed": ("key", "reason = 'transcript'"),
    "pending": ("key", "reason IN ('transcript', 'po_token')"),
}


def missing_transcripts(root: Path) -> list[str]:
    """Videos that pass every other stage and have no transcript, for programs that make one, such
    as Whisper: their ids, the most viewed first, of equal ones by id.

    Raises FatalError before the first filter, DamagedData.
    """
    if manifest.read_manifest(root, _FOLDER) is None:
        raise FatalError(f"{root} has no filtered videos", hint="run `kb youtube filter` first")
    manifest.check_complete(root, _FOLDER)
    ids: set[str] = set()
    for name, (key, condition) in _WITHOUT.items():
        if files := parquet_files(Layout(root).clean("youtube", name)):
            parquet.verify_files(*files)
            asked = f"SELECT {key} FROM {scan(files)} WHERE {condition}"
            with reading(files), database.over(files, root) as con:
                ids.update(one for (one,) in con.execute(asked).fetchall())
    views = _views(root, ids)
    return sorted(ids, key=lambda one: (-views.get(one, 0), one))


def _views(root: Path, ids: set[str]) -> dict[str, int]:
    """The newest count of each video's views, as far as any answer or file has one."""
    newest: dict[str, tuple[str, int]] = {}
    for kind in (RAW_VIDEOS, RAW_STATISTICS, RAW_INFO):
        at = ("view_count",) if kind == RAW_INFO else ("statistics", "viewCount")
        for envelope in rawlog.envelopes(root, "youtube", kind):
            answer: Any = envelope.response
            for one in [answer] if kind == RAW_INFO else inner(answer, "items") or ():
                key, count = inner(one, "id"), str(inner(one, *at))
                if key in ids and count.isdecimal():
                    counted = (envelope.fetched_at or "", int(count))
                    newest[key] = max(counted, newest.get(key, counted))
    return {key: count for key, (_, count) in newest.items()}
