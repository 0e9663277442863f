"""What a run of a command leaves behind for an operator: lines of the log, a record in the root."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Mapping
from contextlib import AbstractContextManager
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

from kb.cli.framework import messages
from kb.cli.framework.options import RUNS, data_folder
from kb.core import clock
from kb.core.errors import KbError, UsageError
from kb.core.progress import EVENTS

if TYPE_CHECKING:
    from kb.cli.framework.options import Options

OWN = {"own": True}
"""Marks the records with which a command's log begins and ends."""
_WITHOUT_DOTENV = ("demo", "sandbox")


def logging_of(options: Options, command: str) -> AbstractContextManager[None]:
    """Events of the block go to the file of --log or KB_LOG, if there is one."""
    path = options.log or _named(command)
    if path is None:
        return contextlib.nullcontext()
    from kb.artifacts.table_catalog import Catalog, refuse_download
    from kb.core.run_log import logging_to
    from kb.net import redact

    path = path.expanduser().absolute()
    try:
        refuse_download(path, "--log")
        root = data_folder(options.data).absolute()
        if Catalog(root).is_download and path.resolve().is_relative_to(root.resolve()):
            raise UsageError(f"{path} is inside the download {root}")
    except KbError as error:
        messages.warn(f"the log is not written: {error}")
        return contextlib.nullcontext()
    return logging_to(path, command, redact.text, messages.warn)


def _named(command: str) -> Path | None:
    """KB_LOG of the environment, or of `.env` where a command reads it."""
    name = os.environ.get("KB_LOG", "")
    if not name and command not in _WITHOUT_DOTENV and Path(".env").is_file():
        from dotenv import dotenv_values

        with contextlib.suppress(OSError, UnicodeDecodeError):
            name = dotenv_values(".env").get("KB_LOG") or ""
    return Path(name) if name else None


def log_end(code: int, seconds: float, summary: Mapping[str, Any]) -> None:
    """The last line of a run: exit code, time, what it waits for, figures."""
    if not any(type(handler).__name__ == "LogFile" for handler in EVENTS.handlers):
        return
    from kb.store.state.run_records import figures, in_words

    words = [f"ends with exit code {code} after {seconds:.1f} s"]
    words += [f"waits for {summary['waits_for']}"] if summary.get("waits_for") else []
    words += [numbers] if (numbers := in_words(figures(summary))) else []
    EVENTS.info("%s", ", ".join(words), extra=OWN)


def record_run(
    command: str,
    start: datetime,
    seconds: float,
    code: int,
    summary: Mapping[str, Any],
) -> None:
    """Leave a record in the data root that the command wrote to, if there is one by now; a warning
    where that fails.
    """
    run = RUNS[-1] if RUNS else None
    if run is None or not os.access(run.root, os.W_OK):
        return
    from kb.artifacts.data_roots import is_root
    from kb.store.state import run_records

    if not is_root(run.root):  # a download, or the command has made nothing
        return
    try:
        run_records.keep(
            run.root,
            run.profile,
            command=command,
            start=start,
            end=clock.now(),
            seconds=seconds,
            exit_code=code,
            summary=summary,
        )
    except (OSError, KbError) as error:
        messages.warn(f"the run is not recorded in {run.root}/{run_records.FOLDER}: {error}")
