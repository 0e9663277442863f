"""What a source's clean and released tables were made of, so that what is out of date is known by
content, never by file times: a copied root is as fresh as the one it was copied from.

    clean/<source>/inputs.json         a digest of raw/<source>, as the filter read it
    state/release-<source>.exported    a digest of the clean tables, as the export read them
"""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Iterable
from pathlib import Path

from kb.artifacts import complete
from kb.schema.tables import released_tables
from kb.store import parquet, rawlog
from kb.store.atomic import write_text
from kb.store.layout import Layout

NAME = "inputs.json"


def of_raw(root: Path, source: str) -> str:
    """A digest of the names and sizes of all raw files: segments only grow, and each other file is
    named by its content.
    """
    top = Layout(root).raw(source)
    return _digest(
        f"{os.path.relpath(path, top).removesuffix(rawlog.OPEN.removeprefix(rawlog.SUFFIX))}"
        f" {path.stat().st_size}"
        for path in top.rglob("*.*")
        if path.is_file() and not path.name.startswith(".")
    )


def note_raw(folder: Path, digest: str) -> None:
    """Note in a clean folder which raw data it was made of."""
    write_text(folder / NAME, json.dumps({"raw": digest}) + "\n")


def is_filtered(root: Path, source: str) -> bool:
    """Whether clean/<source> was made of the raw data that is there now; true where nothing was
    noted.
    """
    path = Layout(root).clean(source) / NAME
    if not path.is_file():
        return Layout(root).summary(source).is_file()
    try:
        noted = json.loads(path.read_text(encoding="utf-8"))
    except ValueError:
        return False
    return isinstance(noted, dict) and noted.get("raw") == of_raw(root, source)


def of_clean(root: Path, source: str) -> str:
    """A digest of the clean tables that are released. Raises DamagedData for a lost file."""
    shorts = [declared.short for declared in released_tables(source)]
    files = complete.files(root, source, shorts)
    return _digest(f"{name} {parquet.fingerprint(path)}" for name, path in files.items())


def is_exported(root: Path, source: str) -> bool:
    """Whether release/<source> was made of the clean tables that are there now; true where nothing
    was noted. Raises DamagedData.
    """
    noted = complete.exported_from(root, source)
    return noted is not None and noted in ("", of_clean(root, source))


def _digest(lines: Iterable[str]) -> str:
    return hashlib.sha256("\n".join(sorted(lines)).encode()).hexdigest()
