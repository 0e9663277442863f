"""The log of `--log FILE`: one line an event, with time, level, command and process.

    2026-11-28T04:17:02Z info youtube crawl[4711] metadata: 300/300 videos, 4 failed

Only the process of the command writes the file; worker processes send it their records. What a log
keeps for months must hold no secret and nothing that a purge removes: ids, names, quoted words and
what stands behind a host are written as `…`, and of a purge only its figures are kept.
"""

import contextlib
import logging
import logging.handlers
import os
import re
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

from kb.core import clock, terminal
from kb.core.progress import EVENTS
from kb.core.regular_file import check_regular
from kb.core.sources import SOURCES

BYTES, KEPT = 10_000_000, 5
MARK = "…"
_ID = r"[A-Za-z0-9_-]"
_PLACES = "|".join(f"{name}:" for name in SOURCES)  # references begin so
_PRIVATE = (
    (re.compile(r"(https?://[^/\s'\"]+)/[^\s'\"]*[^\s'\":;,.)]"), rf"\1/{MARK}"),
    # what is quoted, but for keys of a profile ('youtube.min_views')
    (re.compile(r"(['\"“])(?![a-z_]+\.[a-z_.]+['\"])[^'\"“”\n]*(['\"”])"), rf"\1{MARK}\2"),
    (re.compile(rf"\bt[1-6]_[0-9a-z]+\b|\b(?:UC|PL|UU|OL){_ID}{{10,40}}"), MARK),
    (re.compile(rf"(?<![\w/])/?u(?:ser)?/{_ID}+"), MARK),
    (
        re.compile(rf"\b({_PLACES}|(?:post|comment|page) )(?=\S*\d){_ID}+"),
        rf"\1{MARK}",
    ),
    # a video's id: eleven characters that are no word
    (
        re.compile(
            rf"(?<![\w.-])(?=\S*[0-9A-Z_])(?!(?:[A-Z]?[a-z-]+|\d+)(?![\w-])){_ID}{{11}}(?![\w-])"
        ),
        MARK,
    ),
)


def private(text: str) -> str:
    """The text in one line, without ids, names and paths of addresses."""
    for pattern, instead in _PRIVATE:
        text = pattern.sub(instead, text)
    return terminal.one_line(text)


class LogFile(logging.handlers.RotatingFileHandler):
    """Appends to the file, and begins another after `BYTES`. The first failure is told to `warn`,
    and nothing is written after it. Several processes may append to one file.
    """

    def __init__(
        self, path: Path, command: str, clean: Callable[[str], str], warn: Callable[[str], None]
    ) -> None:
        super().__init__(path, maxBytes=BYTES, backupCount=KEPT, encoding="utf-8", delay=True)
        self._path, self._command, self._clean, self._warn = path, command, clean, warn
        self._failed = False

    def format(self, record: logging.LogRecord) -> str:
        """The line of a record."""
        text = private(self._clean(record.getMessage()))
        origin = "" if record.name == EVENTS.name else f"{record.name}: "
        level = record.levelname.lower()
        return f"{clock.stamp()} {level} {self._command}[{record.process}] {origin}{text}"

    def emit(self, record: logging.LogRecord) -> None:
        """Write one line. Never raises."""
        named = self._command.startswith("purge ") and record.levelno < logging.ERROR
        if self._failed or (named and not hasattr(record, "own")):  # by what is to be forgotten
            return
        try:
            self._prepare()
        except OSError:
            self.handleError(record)
            return
        super().emit(record)

    def _prepare(self) -> None:
        """Follow the file where another process has begun a new one. Raises OSError."""
        with contextlib.suppress(FileNotFoundError):
            there = check_regular(self._path)
            if self.stream is None or os.path.samestat(there, os.fstat(self.stream.fileno())):
                return
        if self.stream is not None:
            self.stream.close()
            self.stream = None  # opened again by the next record
        self._path.parent.mkdir(parents=True, exist_ok=True)

    def handleError(self, record: logging.LogRecord) -> None:
        """Say once that the log can't be written."""
        if not self._failed:
            self._failed = True
            error = sys.exc_info()[1]
            why = getattr(error, "strerror", None) or str(error)
            self._warn(
                f"the log {self._path} can't be written ({why}); the command goes on without"
            )


@contextlib.contextmanager
def logging_to(
    path: Path, command: str, clean: Callable[[str], str], warn: Callable[[str], None]
) -> Iterator[bool]:
    """Write the events of the block, and what libraries log, into a file. `clean` removes secrets.

    `warn` is told once, in words, where the file can't be written.
    """
    handler = LogFile(path, command, clean, warn)
    loggers = (EVENTS, logging.getLogger())
    for logger in loggers:
        logger.addHandler(handler)
    try:
        yield True
    finally:
        for logger in loggers:
            logger.removeHandler(handler)
        with contextlib.suppress(OSError, ValueError):  # a full disk, which was told
            handler.close()
