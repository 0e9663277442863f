"""Where an answer goes: to a terminal, a pipe or a file, in the format that it is for."""

from __future__ import annotations

import contextlib
import shutil
import sys
from collections.abc import Iterable
from pathlib import Path
from typing import IO

import pyarrow as pa

from kb.core.errors import UsageError
from kb.query.box import as_box
from kb.query.text import as_csv, as_json, as_ndjson, as_table
from kb.store import parquet
from kb.store.atomic import writing

SUFFIXES = {
    ".csv": "csv",
    ".json": "json",
    ".ndjson": "ndjson",
    ".jsonl": "ndjson",
    ".parquet": "parquet",
    ".txt": "table",
}
_LINES = {
    "table": as_table,
    "csv": as_csv,
    "json": as_json,
    "ndjson": as_ndjson,
}


def choose(given: str | None, out: Path | None) -> str:
    """The format that was asked for, else that of the file's suffix, else a table.

    Raises UsageError where `out` can't be written to, its suffix says no format and none is given,
    or Parquet would go to a terminal.
    """
    if out is None:
        if given == "parquet" and sys.stdout.isatty():
            raise UsageError(
                "Parquet is no text for a terminal", hint="add --out FILE, or redirect stdout"
            )
        return given or "table"
    if out.is_dir():
        raise UsageError(f"--out {out} is a folder", hint="name a file in it")
    if not out.resolve().parent.is_dir():
        raise UsageError(
            f"--out {out}: no such folder {out.resolve().parent}", hint="make it, or check the name"
        )
    if given is None and out.suffix.lower() not in SUFFIXES and not _special(out):
        raise UsageError(
            f"--out {out}: its suffix says no format",
            hint=f"end it with one of {' '.join(SUFFIXES)}, or give --format",
        )
    return given or SUFFIXES.get(out.suffix.lower(), "table")


def write(answer: pa.RecordBatchReader, format: str, out: Path | None) -> None:
    """Write every row. A file appears whole or not at all, in the place of what a link points to.

    A table on a terminal is DuckDB's box. Raises UsageError where Parquet can't hold a column.
    """
    if out is None:
        _to_stdout(answer, format)
    elif format == "parquet" and not _special(out):
        with _opened(out) as path:
            _parquet(answer, path)
    elif format == "parquet":
        with out.open("wb") as binary:
            _parquet(answer, binary)
    else:
        with _opened(out) as path, path.open("w", encoding="utf-8") as file:
            file.writelines(_LINES[format](answer))


def for_people(answer: pa.RecordBatchReader) -> Iterable[str]:
    """The table as it fits to where stdout goes."""
    if sys.stdout.isatty():
        return as_box(answer, shutil.get_terminal_size().columns)
    return as_table(answer)


def _to_stdout(answer: pa.RecordBatchReader, format: str) -> None:
    if format == "parquet":
        _parquet(answer, sys.stdout.buffer)
        return
    sys.stdout.writelines(for_people(answer) if format == "table" else _LINES[format](answer))
    sys.stdout.flush()


def _parquet(answer: pa.RecordBatchReader, file: Path | IO[bytes]) -> None:
    try:
        with parquet.writing(file, answer.schema) as writer:
            for batch in answer:
                writer.write_batch(batch)
    except pa.ArrowNotImplementedError as error:
        raise UsageError(
            f"Parquet can't hold a column of this answer: {error}",
            hint="cast it to text: NAME::VARCHAR",
        ) from None


def _special(out: Path) -> bool:
    """A device or pipe, which is written to as it is."""
    return out.exists() and not out.is_file()


def _opened(out: Path) -> contextlib.AbstractContextManager[Path]:
    return contextlib.nullcontext(out) if _special(out) else writing(out.resolve())
