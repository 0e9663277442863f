"""Collects what `kb status` shows, the next commands included. Only reads, and never waits for or
stops a running crawl.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from contextlib import suppress
from datetime import timedelta
from pathlib import Path
from typing import TYPE_CHECKING, Any

from kb.artifacts import freshness
from kb.artifacts.table_catalog import Catalog, view_name
from kb.cli.framework.messages import complete
from kb.core import clock
from kb.core.errors import DamagedData, WriterLocked
from kb.core.sources import SOURCES
from kb.core.summary import vocabulary
from kb.crawl.job import STOPPED
from kb.crawl.session import replay_unread_answers
from kb.registry import SOURCES as CLASSES
from kb.schema.tables import tables as declared_tables
from kb.schema.tables import tables_of
from kb.store import lock
from kb.store.layout import TOP, VERDICTS, Layout, parquet_files
from kb.store.rawlog import rawlog
from kb.store.tables import parquet, reading
from kb.store.tables.row_counts import rows, span, tally
from kb.store.walk import files_below

if TYPE_CHECKING:
    from kb.core.context import Run
    from kb.source import Source


def next_steps(sources: dict[str, dict[str, Any]], stale: Any) -> list[str]:
    """The next commands, as they have to be typed: what a source needs, then `kb build`."""
    steps = [step for name, about in sources.items() if (step := _step(name, about))]
    if stale and not any(about["running_pid"] for about in sources.values()):
        steps.append("build")
    return [complete(step) for step in steps]


def _step(source: str, about: dict[str, Any]) -> str:
    """The next command that asks a service: crawl or refresh. A source with a credential is not
    crawled without it.
    """
    of = SOURCES[source]
    if about["running_pid"]:
        return ""
    if about["lacks"]:
        alone = of.keyless and set(about["left_by"]) == {of.keyless}
        return f"{source} crawl --only {of.keyless}" if alone else ""
    if of.refreshed and set(about["left_by"]) == {of.noun(of.refreshed)}:
        return f"refresh {source}"
    failed = sum(counts.get("error", 0) for counts in about["phases"].values())
    if about["left"] or failed:
        return f"{source} crawl"
    return f"refresh {source}" if about["too_old"] else ""


_ANSWERS = ("crawled", "kept", "rejected", "failed", "pending", "missing")
_LEFT = ("todo", "in_progress")  # failed items are counted separately, as in a crawl's summary


def overview(run: Run) -> dict[str, Any]:
    """Facts about the data root: by source, disk use in bytes by folder, next commands."""
    catalog = Catalog(run.root)
    if run.profile.path != Path() and not catalog.is_download:
        _replay_unread_answers(run)
    sources = {source: about for source in SOURCES if (about := _source(run, source, catalog))}
    links = _schema_rows(catalog, "links", "links")
    stale = []
    if run.profile.path != Path() and not catalog.is_download:
        outdated = freshness.plan(run, freshness.graph(run))
        stale = freshness.steps(outdated)
    disk = (
        {folder.path.name: folder.size for folder in catalog.releases}
        if catalog.is_download
        else {}
    )
    if not disk:
        folders = [run.root / name for name in (*TOP, "demo") if (run.root / name).is_dir()]
        disk = {path.name: _size(path) for path in folders}
    collected = any(about["rows"] or about["phases"] for about in sources.values())
    return {
        "data": str(run.root),
        "profile": run.profile.name,
        "sources": sources,
        "left": sum(source["left"] for source in sources.values()),
        "too_old": sum(source["too_old"] for source in sources.values()),
        "links": links,
        "disk_bytes": disk,
        "disk_bytes_total": sum(disk.values()),
        "download": catalog.is_download,
        "pairs": {
            schema: _schema_rows(catalog, schema, "pairs").get("pairs", 0)
            for schema in ("clean", "restored", "release")
        },
        "tasks": _schema_rows(catalog, "clean", "tasks").get("tasks", 0)
        or _schema_rows(catalog, "release", "tasks").get("tasks", 0),
        "stale": stale,
        "next": next_steps(sources, stale) if collected or stale else [],
    }


def _replay_unread_answers(run: Run) -> None:
    for name, source in CLASSES.items():
        try:
            replay_unread_answers(run, name, source.connector)
        except WriterLocked:
            continue  # another command is at it
        except DamagedData as error:  # what could be read is replayed
            run.progress.say(f"{error}; {error.hint}")
        except OSError as error:
            run.progress.say(
                f"{name}: its state is missing, and {run.root} can't be written"
                f" ({error.strerror}); run `kb {name} filter` as a user who may write there"
            )


def _source(run: Run, source: str, catalog: Catalog) -> dict[str, Any]:
    """Progress, quota, age and rows of a source; empty without data of it."""
    of, state = SOURCES[source], Layout(run.root).state(source)
    own = (declared.short for declared in tables_of(source))
    clean = {short: Layout(run.root).clean(source, short) for short in (*own, *VERDICTS)}
    tables = _in_order({short: rows(path) for short, path in clean.items() if parquet_files(path)})
    released, restored = (
        _schema_rows(catalog, schema, source) for schema in ("release", "restored")
    )
    has_raw = rawlog.any_answer(run.root, source)
    if not (state.exists() or has_raw or tables or released or restored):
        return {}
    pid = lock.holders(run.root).get(source, "")
    about: dict[str, Any] = {
        "running_pid": int(pid) if pid.isdigit() else None,
        "lacks": of.credential
        if of.credential and getattr(run.settings, of.credential) is None
        else "",
        "counted": of.counted,
        "phases": {},
        "failures": {},
        "left_by": {},
        "crawled_so_far": 0,
        "requests": 0,
        "units": 0,
        "stopped": "",
        "waits_for": "",
        "quota": {},
    }
    if state.exists():
        about |= _frontier(run, CLASSES[source], state)
    about["unread"] = has_raw and not (about["phases"] or tables)
    about["left"] = sum(counts["left"] for counts in about["phases"].values())
    about["rows"] = tables
    about |= _verdicts(run.root, source)
    about |= {"released": released, "restored": restored}
    about |= _age(run, source, catalog)
    about["waiting"] = _waiting(run.root, source)
    # Keys of answers that schemas/ does not declare, as often as the last filter saw them.
    keys = reading.filtered(run.root, source).get("unknown_keys")
    about["unknown_keys"] = keys if isinstance(keys, dict) else {}
    return about


def _frontier(run: Run, source: Source, state: Path) -> dict[str, Any]:
    of = source.declared
    with reading.state(state) as frontier:
        kinds = frontier.kinds()
        phases = {}
        for kind in of.in_order(kinds):
            counts = kinds[kind]
            phases[of.noun(kind)] = {
                **counts,
                "total": sum(counts.values()),
                "left": sum(counts.get(status, 0) for status in _LEFT),
            }
        requests, _ = frontier.requests()
        return {
            "phases": phases,
            "failures": frontier.failures(),
            "left_by": of.left_by(kinds),
            "crawled_so_far": source.crawled(frontier),
            "requests": requests,
            **frontier.cursor(STOPPED, {}, of=dict[str, str]),
            **source.status(run, frontier),
        }


def _verdicts(root: Path, source: str) -> dict[str, Any]:
    """The four verdicts of the last filter, in total and by table; empty before the first."""
    by_table = tally(Layout(root).clean(source), SOURCES[source].tables)
    if not by_table:
        return {"tally": {}}
    total = {name: sum(counts[name] for counts in by_table.values()) for name in _ANSWERS}
    return {**total, "tally": by_table}


def _waiting(root: Path, source: str) -> dict[str, int]:
    """Pending rows of the last filter, by reason."""
    counts: Counter[str] = Counter()
    for path in parquet_files(Layout(root).clean(source) / "pending"):
        counts.update(map(str, parquet.read_table(path, columns=["reason"])["reason"].to_pylist()))
    return dict(sorted(counts.items()))


def _schema_rows(catalog: Catalog, schema: str, source: str) -> dict[str, int]:
    """Rows by table of a source in one schema of the catalog, such as release or restored."""
    named = {f"{schema}.{view_name(table)}": table for table in declared_tables().values()}
    counts: dict[str, int] = {}
    for view in catalog.views:
        table = named.get(view.full)
        if table is not None and table.source == source and table.short != "missing":
            with reading.reading(view.files):
                counts[table.short] = sum(parquet.footer(file).num_rows for file in view.files)
    return _in_order(counts)


def _age(run: Run, source: str, catalog: Catalog) -> dict[str, Any]:
    """Age of the kept, restored or released rows, and how many are too old for the profile."""
    max_age = getattr(getattr(run.profile, source), "max_age_days", None)
    limit = clock.now() - timedelta(days=max_age or 0)
    schema = catalog.schema_of(source)
    shown = {f"{schema}.{source}_{short}" for short in SOURCES[source].tables}
    files = [file for view in catalog.views if view.full in shown for file in view.files]
    with reading.reading(files):
        oldest, newest, old = span(files, "fetched_at", limit, SOURCES[source].aging)
    return {
        "oldest": f"{oldest:%Y-%m-%dT%H:%M:%SZ}" if oldest else None,
        "newest": f"{newest:%Y-%m-%dT%H:%M:%SZ}" if newest else None,
        "max_age_days": max_age,
        "too_old": old if max_age else 0,
    }


def _in_order(counts: Mapping[str, int]) -> dict[str, int]:
    return dict(sorted(counts.items(), key=lambda item: vocabulary.place(item[0])))


def _size(folder: Path) -> int:
    """Bytes of all files in a folder; what vanishes meanwhile or can't be read is not counted."""
    total = 0
    for path in files_below(folder, strict=False):
        with suppress(FileNotFoundError, PermissionError):
            total += path.stat().st_size
    return total
