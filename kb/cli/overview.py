"""What `kb status` says about a data root. Reads only, and never waits for or stops a running
crawl.
"""

from __future__ import annotations

import fcntl
import importlib
import os
from collections.abc import Iterator
from datetime import datetime, timedelta
from pathlib import Path
from typing import TYPE_CHECKING, Any

from kb.cli.as_typed import completed
from kb.core import clock, vocabulary
from kb.core.sources import SORTED, SOURCES
from kb.store.layout import TOP, Layout, parquet_files

if TYPE_CHECKING:
    from kb.core.context import Run

_SOME = 20  # names of posts that are shown
_LEFT = ("todo", "in_progress")  # what failed is counted by itself, as in a crawl's summary


def overview(run: Run) -> dict[str, Any]:
    """All about the data root: by source, disk use in bytes by folder, what to type next."""
    sources = {source: about for source in SOURCES if (about := _source(run, source))}
    links = _links(run.root)
    disk = {path.name: _size(path) for path in _folders(run.root)}
    return {
        "data": str(run.root),
        "profile": run.profile.name,
        "sources": sources,
        "left": sum(source["left"] for source in sources.values()),
        "too_old": sum(source["too_old"] for source in sources.values()),
        "links": links,
        "disk_bytes": disk,
        "disk_bytes_total": sum(disk.values()),
        "next": _next(run, sources, links),
    }


def _source(run: Run, source: str) -> dict[str, Any]:
    """Progress, quota, age and rows of one source; empty when nothing was collected."""
    state = Layout(run.root).state(source)
    tables = _tables(run.root, source)
    if not state.is_file() and not tables:
        return {}
    about: dict[str, Any] = {
        "running_pid": _writer(run.root, source),
        "counted": vocabulary.counted(source),
        "phases": {},
        "left_by": {},
        "crawled_so_far": 0,
        "requests": 0,
        "units": 0,
        "quota": {},
    }
    if state.is_file():
        about |= _frontier(run, source, state)
    about["left"] = sum(counts["left"] for counts in about["phases"].values())
    about["rows"] = tables
    about |= _answers(run.root, source)
    about["released"] = _released(run.root, source)
    about |= _age(run, source)
    about["unknown_keys"] = _unknown_keys(run.root, source)
    if source == "reddit":
        about |= _incomplete(run.root)
    return about


def _incomplete(root: Path) -> dict[str, Any]:
    """Posts of which a part of the tree could not be read, as summaries count them,
    and the names of some.
    """
    from kb.reddit.state import incomplete_posts

    found = sorted(incomplete_posts(root))
    return {"incomplete_posts": len(found), "incomplete": [f"t3_{key}" for key in found[:_SOME]]}


def _frontier(run: Run, source: str, state: Path) -> dict[str, Any]:
    from kb.store import reading

    with reading.state(state) as frontier:
        kinds = frontier.kinds()
        phases = {}
        for kind in vocabulary.in_order(source, kinds):
            counts = kinds[kind]
            phases[vocabulary.noun(source, kind)] = {
                **counts,
                "total": sum(counts.values()),
                "left": sum(counts.get(status, 0) for status in _LEFT),
            }
        requests, units = frontier.requests()
        return {
            "phases": phases,
            "left_by": vocabulary.left_by(source, kinds),
            "crawled_so_far": _crawled(source, frontier),
            # The wiki's crawl kept no ledger before, only a number.
            "requests": requests + frontier.cursor("requests", 0),
            "units": units if source == "youtube" else 0,
            "quota": _quota(run, source, frontier),
        }


def _crawled(source: str, frontier: Any) -> int:
    """What the crawls of all runs have read, as their summaries count it."""
    return int(importlib.import_module(f"kb.{source}.reduce").crawled(frontier))


def _answers(root: Path, source: str) -> dict[str, Any]:
    """The four answers of the last filter, together and by table; nothing before the first."""
    from kb.store.tally import tally

    found = tally(Layout(root).clean(source), SORTED[source])
    names = ("crawled", "kept", "rejected", "failed", "pending", "missing")
    total = {name: sum(each[name] for each in found.values()) for name in names}
    return {**total, "tally": found} if found else {"tally": {}}


def _released(root: Path, source: str) -> dict[str, int]:
    """Rows by table of release/<source>."""
    from kb.store import parquet
    from kb.store.reading import reading

    files = parquet_files(Layout(root).release(source), "*-of-*.parquet")  # tombstones are no rows
    found: dict[str, int] = {}
    with reading(files):
        for file in files:
            name = file.name.split("-", 1)[0]
            found[name] = found.get(name, 0) + parquet.footer(file).num_rows
    return dict(sorted(found.items(), key=lambda item: vocabulary.place(item[0])))


def _links(root: Path) -> dict[str, Any]:
    """The entity tables, and which clean tables are newer than they; empty when there are none."""
    from kb.store import linked

    note = linked.read(root)
    if note is None:
        return {}
    made, at = _newest(linked.path(root)), Layout(root)
    newer = [source for source in SOURCES if _newest(at.summary(source)) > made]
    return {"entities": note.entities, "links": note.links, "older_than": newer}


def _next(run: Run, sources: dict[str, dict[str, Any]], links: dict[str, Any]) -> list[str]:
    """The commands to type now, as they have to be typed; each source goes on by itself."""
    root, found = run.root, []
    at = Layout(root)
    for source, about in sources.items():
        step = _step(root, source, about)
        found += [step] if step else []
    if sources and not found:
        found = [
            name
            for name, made in (
                ("pairs", not sources.get("youtube") or bool(parquet_files(at.pairs))),
                ("links", run.profile.pairs is None or bool(links and not links["older_than"])),
                ("release", any(at.release().glob("*/SHA256SUMS"))),
                ("report", at.page.is_file()),
            )
            if not made
        ][:1]
    return [completed(step) for step in found]


def _step(root: Path, source: str, about: dict[str, Any]) -> str:
    """What a source's data need next: to be read to the end, sorted, kept fresh, exported."""
    if about["running_pid"]:
        return ""
    refresh = vocabulary.noun(source, {"youtube": "refresh", "reddit": "info"}.get(source, ""))
    if set(about["left_by"]) == {refresh}:
        return f"refresh {source}"
    failed = sum(counts.get("error", 0) for counts in about["phases"].values())
    if about["left"] or failed:
        return f"{source} crawl"
    at = Layout(root)
    clean = at.summary(source)
    if _newest(at.raw(source)) > _newest(clean):
        return f"{source} filter"
    if about["too_old"]:
        return f"refresh {source}"
    if _newest(clean) > _newest(at.release(source)):
        return f"{source} export"
    return ""


def _newest(path: Path) -> float:
    """When a file, or any file of a folder, was changed last; 0 for none."""
    files = path.rglob("*.*") if path.is_dir() else [path] if path.is_file() else []
    return max((file.stat().st_mtime for file in files if file.is_file()), default=0.0)


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
    from kb.store.reading import reading
    from kb.store.tally import span

    section = getattr(run.profile, source)
    max_age = getattr(section, "max_age_days", None)
    oldest: datetime | None = None
    newest: datetime | None = None
    too_old = 0
    limit = clock.now() - timedelta(days=max_age or 0)
    for folder in _table_folders(run.root, source):
        files = parquet_files(folder)
        with reading(files):
            low, high, old = span(files, "fetched_at", limit)
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
    from kb.store import parquet
    from kb.store.reading import reading

    found = {}
    for folder in _table_folders(root, source, verdicts=True):
        files = parquet_files(folder)
        with reading(files):
            found[folder.name] = sum(parquet.footer(file).num_rows for file in files)
    return dict(sorted(found.items(), key=lambda item: vocabulary.place(item[0])))


def _table_folders(root: Path, source: str, *, verdicts: bool = False) -> list[Path]:
    clean = Layout(root).clean(source)
    if not clean.is_dir():
        return []
    return [
        path
        for path in sorted(clean.iterdir())
        if parquet_files(path) and (verdicts or path.name not in ("rejected", "failed", "pending"))
    ]


def _unknown_keys(root: Path, source: str) -> dict[str, int]:
    """Keys of answers that schemas/ does not declare, with how often they were seen by the last
    filter.
    """
    from kb.store.reading import filtered

    found = filtered(root, source).get("unknown_keys", {})
    return found if isinstance(found, dict) else {}


def _writer(root: Path, source: str) -> int | None:
    """The pid of the process that writes to the source now."""
    path = Layout(root).lock(source)
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
    yield from (root / name for name in (*TOP, "demo") if (root / name).is_dir())


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
