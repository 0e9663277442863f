"""Writes results to a terminal, a pipe or a file, in the right format for it."""

import contextlib
import shutil
import sys
from collections.abc import Iterable
from pathlib import Path
from typing import IO

import pyarrow as pa

from kb.core import terminal
from kb.core.errors import UsageError
from kb.query.formats import as_box, as_csv, as_json, as_ndjson, as_table
from kb.store.atomic import writing
from kb.store.tables import parquet

SUFFIXES = {
    ".csv": "csv",
    ".json": "json",
    ".ndjson": "ndjson",
    ".jsonl": "ndjson",
    ".parquet": "parquet",
    ".txt": "table",
}
_LINES = {"table": as_table, "csv": as_csv, "json": as_json, "ndjson": as_ndjson}


def choose(given: str | None, out: Path | None) -> str:
    """The given format, else that of the file's suffix, else a table.

    Raises UsageError if `out` can't be written, if no format is given and the suffix is unknown, or
    if Parquet would be written to a terminal.
    """
    if out is None:
        if given == "parquet" and sys.stdout.isatty():
            raise UsageError(
                "Parquet can't be written to a terminal", hint="add --out FILE, or redirect stdout"
            )
        return given or "table"
    if out.is_dir():
        raise UsageError(f"--out {out} is a folder", hint="name a file in it")
    if not out.resolve().parent.is_dir():
        raise UsageError(
            f"--out {out}: there is no folder {out.resolve().parent}",
            hint="create it, or check the name",
        )
    if given is None and out.suffix.lower() not in SUFFIXES and not _special(out):
        raise UsageError(
            f"--out {out}: unknown suffix",
            hint=f"use one of {' '.join(SUFFIXES)}, or give --format",
        )
    return given or SUFFIXES.get(out.suffix.lower(), "table")


def write(answer: pa.RecordBatchReader, format: str, out: Path | None) -> None:
    """Write every row. A file is replaced atomically, and links are followed.

    A table on a terminal is DuckDB's box. Raises UsageError if Parquet can't hold a column.
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
    """A table that suits stdout."""
    if sys.stdout.isatty():
        return as_box(answer, shutil.get_terminal_size().columns)
    return as_table(answer)


def _to_stdout(answer: pa.RecordBatchReader, format: str) -> None:
    if format == "parquet":
        _parquet(answer, sys.stdout.buffer)
        return
    lines = for_people(answer) if format == "table" else _LINES[format](answer)
    if sys.stdout.isatty():
        # Tables are escaped already; files and pipes get the exact data.
        shown = terminal.json if format in ("json", "ndjson") else terminal.lines
        lines = map(shown, lines)
    sys.stdout.writelines(lines)
    sys.stdout.flush()


def _parquet(answer: pa.RecordBatchReader, file: Path | IO[bytes]) -> None:
    try:
        with parquet.writing(file, answer.schema) as writer:
            for batch in answer:
                writer.write_batch(batch)
    except pa.ArrowNotImplementedError as error:
        raise UsageError(
            f"Parquet can't hold a column of the result: {error}",
            hint="cast it to text: NAME::VARCHAR",
        ) from None


def _special(out: Path) -> bool:
    """Whether it is a device or pipe, which is written in place."""
    return out.exists() and not out.is_file()


def _opened(out: Path) -> contextlib.AbstractContextManager[Path]:
    return contextlib.nullcontext(out) if _special(out) else writing(out.resolve())
