"""Checks across files of a data root: missing files and keys with two verdicts."""

import contextlib
from functools import partial
from pathlib import Path

import duckdb

from kb.artifacts import manifest
from kb.core.errors import DamagedData
from kb.core.sources import PUBLISHED, SOURCES, SPECS
from kb.schema.tables import table
from kb.store import leftovers
from kb.store.artifact_registry import ARTIFACTS, rebuild_hint
from kb.store.layout import Layout, parquet_files
from kb.store.tables import database
from kb.store.tables.reading import scan
from kb.store.tables.row_counts import VERDICTS
from kb.verify import raw, releases
from kb.verify.findings import Findings


def compare(findings: Findings, root: Path) -> None:
    """Add what no file shows by itself: missing files, keys with two verdicts."""
    steps = [
        partial(raw.lost_side_files, findings, root),
        partial(_missing_files, findings, root),
        *(partial(_two_answers, findings, root, source) for source in SOURCES),
        *(partial(_release, findings, root, source) for source in PUBLISHED),
    ]
    for step in steps:
        findings.retrying(step)
    for other in sorted(Layout(root).release().glob("*/")):
        if other.name not in PUBLISHED and not leftovers.is_left((other.name,)):
            findings.foreign("release", other, "no export has written it", "move it away")


def _missing_files(findings: Findings, root: Path) -> None:
    """Add missing files of artifacts; releases are checked by their own checksums."""
    for name, artifact in ARTIFACTS.items():
        kind = name.partition("/")[0]
        if artifact.public or kind == "restored":
            continue
        with contextlib.suppress(DamagedData):  # reported with the manifest itself
            lost = manifest.missing(root, name)
            is_made = manifest.read(root, name) is not None
            if kind == "index" and not is_made and any(artifact.folder(root).glob("*.store")):
                lost = [artifact.manifest(root)]
            for path in lost:
                findings.missing(kind, path, artifact.hint)


def _two_answers(findings: Findings, root: Path, source: str) -> None:
    """crawled = kept + rejected + failed + pending: no key is in two of them."""
    clean = Layout(root).clean(source)
    if any(clean in one.path.parents for one in findings.of("clean")):
        return  # counting makes sense of whole files only
    keys = [
        (
            f"'{prefix}' || {table(f'{source}/{short}').key[0]}::VARCHAR",
            parquet_files(clean / short),
        )
        for short, prefix in SPECS[source].tables.items()
    ]
    keys += [("key", parquet_files(clean / verdict)) for verdict in VERDICTS]
    all_files = [file for _, files in keys for file in files]
    if not all_files:
        return
    parts = [f"SELECT {key} AS key FROM {scan(files)}" for key, files in keys if files]
    sql = f"SELECT count(*) - count(DISTINCT key) FROM ({' UNION ALL '.join(parts)})"
    try:
        with database.over(all_files, root) as con:
            more = (con.execute(sql).fetchone() or (0,))[0]
    except duckdb.Error as error:
        findings.damaged("clean", clean, str(error).splitlines()[0], rebuild_hint(clean / "x"))
        return
    if more:
        what = f"{more:,} keys are in two of kept, rejected, failed and pending"
        findings.damaged("clean", clean / "summary.json", what, rebuild_hint(clean / "x"))


def _release(findings: Findings, root: Path, source: str) -> None:
    folder = Layout(root).release(source)
    if folder.is_dir() and any(folder.iterdir()):
        releases.folder(findings, folder, rebuild_hint, described=False)
    elif manifest.read(root, f"release/{source}"):
        findings.missing("release", folder, rebuild_hint(folder / "x"))
