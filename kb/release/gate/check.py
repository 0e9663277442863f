"""The gate: every reason not to publish, all at once, one line each.

`check(run, folders)` reads what the exports wrote, `check_made(run, folders)` what `kb release`
added. An empty list opens the gate. Nothing is written here.
"""

import json
from pathlib import Path

import pyarrow.parquet as pq
from pydantic import ValidationError

from kb.artifacts.release_folder import ReleaseFolder
from kb.core.context import Run
from kb.core.errors import KbError
from kb.core.licences import KNOWN, licence
from kb.core.sources import RELEASES
from kb.release.folders import DEPOSIT, REQUIRED
from kb.release.gate import GateProblem, files, personal, rows, secrets, tables
from kb.release.metadata.measure import folder_licence, licences
from kb.release.metadata.zenodo import Document


def check(run: Run, folders: list[ReleaseFolder]) -> list[GateProblem]:
    """Every problem of the exported data."""
    problems: list[GateProblem] = []
    for folder in folders:
        problems += files.check_layout(folder)
        of_tables, readable = tables.check(folder)
        problems += of_tables
        problems += rows.check(run, folder, readable)
        problems += files.check_sums(folder, folder.data)
        if len(readable) == len(folder.parts):
            problems += files.check_archives(folder)
            problems += _licence(run, folder)
        problems += secrets.check(folder, run.settings.secret_values())
        problems += personal.check(folder, run.profile.release)
    return problems


def check_made(run: Run, folders: list[ReleaseFolder]) -> list[GateProblem]:
    """Every problem of the files around the data: missing, invalid, or with secrets."""
    problems: list[GateProblem] = []
    for folder in folders:
        problems += [
            GateProblem("incomplete", f"{folder.source}/{name}", "is missing; run `kb release`")
            for name in REQUIRED
            if not (folder.path / name).is_file()
        ]
        problems += files.check_sums(folder, folder.files(), all_listed=True)
        problems += secrets.check(folder, run.settings.secret_values())
        if (folder.path / DEPOSIT).is_file():
            problems += _deposit(folder.path / DEPOSIT, f"{folder.source}/{DEPOSIT}")
    return problems


def _deposit(path: Path, where: str) -> list[GateProblem]:
    """Problems of zenodo.json."""
    try:
        body = json.loads(path.read_text(encoding="utf-8"))
        if not body["metadata"].get("license"):
            return [GateProblem("licence", where, "names no licence; Zenodo would take CC0")]
        Document.model_validate(body)
    except ValidationError as error:
        first = error.errors(include_input=False, include_url=False)[0]
        what = f"{'.'.join(map(str, first['loc']))}: {first['msg']}; run `kb release`"
        return [GateProblem("damaged", where, what)]
    except (ValueError, KeyError, TypeError, AttributeError):
        return [GateProblem("damaged", where, "can't be read; run `kb release`")]
    return []


def _licence(run: Run, folder: ReleaseFolder) -> list[GateProblem]:
    """Problems of the licence that the folder is to be released under."""
    where = f"{folder.source}/LICENSE"
    spec = RELEASES[folder.source]
    named = dict(licences(folder, spec.main)) if spec.licensed else {}
    foreign = sorted(name for name in named if name not in KNOWN)
    if foreign:
        what = (
            f"the pages name {', '.join(foreign[:3])}, which is not a licence that a release can"
            f" use (known: {', '.join(sorted(KNOWN))}); release the other folders with --only"
        )
        return [GateProblem("licence", where, what)]
    problems = []
    main = sum(pq.read_metadata(shard).num_rows for shard in folder.shards(spec.main))
    if named and (unnamed := main - sum(named.values())):
        what = f"{unnamed:,} rows name no licence, though others do; run `kb wiki crawl --again`"
        problems.append(GateProblem("licence", f"{folder.source}/pages", what))
    spdx = folder_licence(run, folder)
    if not spdx:
        what = f"none is given; set {folder.source} in [release.licenses] of the profile"
        return [*problems, GateProblem("licence", where, what)]
    try:
        licence(spdx)
    except KbError as error:
        problems.append(GateProblem("licence", where, f"{error}; {error.hint}"))
    return problems
