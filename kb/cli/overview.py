"""What `kb status` says about a data root. Reads only, and never waits for or stops a running crawl."""

from __future__ import annotations

import fcntl
import os
from collections.abc import Iterator
from datetime import datetime, timedelta
from pathlib import Path
from typing import TYPE_CHECKING, Any

from kb.core import clock

if TYPE_CHECKING:
    from kb.core.context import Run

SOURCES = ("youtube", "wiki", "reddit")
_SOME = 20  # names of posts that are shown
_LEFT = ("todo", "in_progress", "error")


def overview(run: Run) -> dict[str, Any]:
    """Everything about the data root: by source, and disk use in bytes by folder."""
    sources = {source: about for source in SOURCES if (about := _source(run, source))}
    disk = {path.name: _size(path) for path in _folders(run.root)}
    return {
        "data": str(run.root),
        "profile": run.profile.name,
        "sources": sources,
        "left": sum(source["left"] for source in sources.values()),
        "too_old": sum(source["too_old"] for source in sources.values()),
        "disk_bytes": disk,
        "disk_bytes_total": sum(disk.values()),
    }


def _source(run: Run, source: str) -> dict[str, Any]:
    """Progress, quota, age and rows of one source; empty when nothing was collected."""
    state = run.root / "state" / f"{source}.sqlite"
    tables = _tables(run.root, source)
    if not state.is_file() and not tables:
        return {}
    about: dict[str, Any] = {
        "running_pid": _writer(run.root, source),
        "phases": {},
        "requests": 0,
        "units": 0,
        "quota": {},
    }
    if state.is_file():
        about |= _frontier(run, source, state)
    about["left"] = sum(counts["left"] for counts in about["phases"].values())
    about["rows"] = tables
    about |= _age(run, source)
    about["unknown_keys"] = _unknown_keys(run.root, source)
    if source == "reddit":
        about |= _incomplete(run.root)
    return about


def _incomplete(root: Path) -> dict[str, Any]:
    """Posts of which a part of the tree could not be read, as summaries count them, and the names of some."""
    from kb.reddit.state import incomplete_posts

    found = sorted(incomplete_posts(root))
    return {"incomplete_posts": len(found), "incomplete": [f"t3_{key}" for key in found[:_SOME]]}


def _frontier(run: Run, source: str, state: Path) -> dict[str, Any]:
    from kb.store import reading

    with reading.state(state) as frontier:
        phases = {}
        for kind, counts in frontier.kinds().items():
            phases[kind] = {
                **counts,
                "total": sum(counts.values()),
                "left": sum(counts.get(status, 0) for status in _LEFT),
            }
        requests, units = frontier.requests()
        return {
            "phases": phases,
            "requests": requests,
            "units": units,
            "quota": _quota(run, source, frontier),
        }


def _quota(run: Run, source: str, frontier: Any) -> dict[str, Any]:
    """Spent and left of today's buckets. Only YouTube counts units by the day."""
    if source != "youtube" or run.profile.youtube is None:
        return {}
    from kb.youtube import quota

    day, reset_at = quota.today(), quota.next_reset()
    limits = {
        "general": run.profile.youtube.units_per_day,
        "search": run.profile.youtube.searches_per_day,
    }
    return {
        bucket: {
            "spent": (spent := frontier.spent(bucket, day)),
            "left": max(0, limit - spent),
            "limit": limit,
            "resets_at": clock.stamp(reset_at),
        }
        for bucket, limit in limits.items()
    }


def _age(run: Run, source: str) -> dict[str, Any]:
    """How old the kept rows are, and how many are older than the profile allows."""
    import duckdb

    from kb.store.reading import reading, scan

    section = getattr(run.profile, source)
    max_age = getattr(section, "max_age_days", None)
    oldest: datetime | None = None
    newest: datetime | None = None
    too_old = 0
    limit = clock.now() - timedelta(days=max_age or 0)
    for folder in _table_folders(run.root, source):
        files = _files(folder)
        with reading(files), duckdb.connect() as db:
            db.execute("SET TimeZone = 'UTC'")
            columns = {
                row[0] for row in db.execute(f"DESCRIBE SELECT * FROM {scan(files)}").fetchall()
            }
            if "fetched_at" not in columns:
                continue
            low, high, old = db.execute(
                f"SELECT min(fetched_at)::TIMESTAMP, max(fetched_at)::TIMESTAMP, count(*) FILTER (fetched_at < ?::TIMESTAMPTZ) FROM {scan(files)}",
                [clock.stamp(limit)],
            ).fetchone()
        too_old += old if max_age else 0
        oldest = min(filter(None, (oldest, low)), default=None)
        newest = max(filter(None, (newest, high)), default=None)
    return {
        "oldest": f"{oldest:%Y-%m-%dT%H:%M:%SZ}" if oldest else None,
        "newest": f"{newest:%Y-%m-%dT%H:%M:%SZ}" if newest else None,
        "max_age_days": max_age,
        "too_old": too_old,
    }


def _tables(root: Path, source: str) -> dict[str, int]:
    """Rows by table of clean/<source>, from the files' footers."""
    import pyarrow.parquet as pq

    from kb.store.reading import reading

    found = {}
    for folder in _table_folders(root, source, verdicts=True):
        files = _files(folder)
        with reading(files):
            found[folder.name] = sum(pq.read_metadata(file).num_rows for file in files)
    return found


def _files(folder: Path) -> list[Path]:
    return sorted(path for path in folder.glob("*.parquet") if not path.name.startswith("."))


def _table_folders(root: Path, source: str, *, verdicts: bool = False) -> list[Path]:
    clean = root / "clean" / source
    if not clean.is_dir():
        return []
    return [
        path
        for path in sorted(clean.iterdir())
        if _files(path) and (verdicts or path.name not in ("rejected", "failed", "pending"))
    ]


def _unknown_keys(root: Path, source: str) -> dict[str, int]:
    """Keys of answers that schemas/ does not declare, with how often they were seen by the last filter."""
    from kb.store.reading import filtered

    found = filtered(root, source).get("unknown_keys", {})
    return found if isinstance(found, dict) else {}


def _writer(root: Path, source: str) -> int | None:
    """The pid of the process that writes to the source now."""
    path = root / "state" / f"{source}.lock"
    if not path.is_file():
        return None
    descriptor = os.open(path, os.O_RDONLY)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except BlockingIOError:
        pid = os.read(descriptor, 32).decode(errors="replace").strip()
        return int(pid) if pid.isdigit() else None
    finally:
        os.close(descriptor)
    return None


def _folders(root: Path) -> Iterator[Path]:
    names = ("raw", "state", "annotations", "clean", "pairs", "release", "export", "report", "demo")
    yield from (root / name for name in names if (root / name).is_dir())


def _size(folder: Path) -> int:
    """Bytes of all files in a folder; files that vanish meanwhile count nothing."""
    total = 0
    try:
        with os.scandir(folder) as entries:
            for entry in entries:
                if entry.is_dir(follow_symlinks=False):
                    total += _size(Path(entry.path))
                elif entry.is_file(follow_symlinks=False):
                    total += entry.stat(follow_symlinks=False).st_size
    except FileNotFoundError:
        pass
    return total
