"""Log lines on stderr, ours and those of libraries, with secrets redacted."""

import logging
import os
import sys
import warnings
from typing import Any

from kb.core import terminal
from kb.net import redact


class Stderr:
    """Writes to whatever sys.stderr is now, so that lines go above a live progress display."""

    def msg(self, text: str) -> None:
        """One redacted line, or several where it holds a traceback."""
        print(terminal.lines(redact.text(text)), file=sys.stderr, flush=True)

    log = debug = info = warn = warning = error = critical = exception = fatal = msg


class Handler(logging.Handler):
    """Prints log records of libraries (praw, urllib3, selenium …) in the same way."""

    def emit(self, record: logging.LogRecord) -> None:
        """One redacted line; never raises."""
        try:
            message, _, trace = self.format(record).partition("\nTraceback ")
            line = f"{record.levelname.lower()}: {record.name}: {message}"
            text = terminal.one_line(redact.text(line))
            if trace:
                text += "\n" + _indented(redact.text(f"Traceback {trace}"))
            print(text, file=sys.stderr, flush=True)
        except Exception:  # noqa: BLE001  a log line must not end a crawl
            self.handleError(record)


def _safe(logger: Any, method: str, event: dict[str, Any]) -> dict[str, Any]:
    """Values of an event in one line each; only a traceback has lines of its own."""
    return {name: _value(name, value) for name, value in event.items()}


def _value(name: str, value: Any) -> Any:
    if not isinstance(value, str):
        return value
    return _indented(value) if name == "exception" else terminal.one_line(value)


def _indented(trace: str) -> str:
    """A traceback whose lines can't be taken for lines of ours."""
    return terminal.lines("\n".join(f"  {line}" for line in trace.splitlines()))


def configure(*, quiet: bool, debug: bool) -> None:
    """Set the level: warnings with --quiet, everything with --debug, otherwise information."""
    import structlog

    if not debug:
        # Deprecations inside libraries tell users nothing; worker processes read the variable.
        warnings.simplefilter("ignore")
        os.environ.setdefault("PYTHONWARNINGS", "ignore")
    level = logging.DEBUG if debug else logging.WARNING if quiet else logging.INFO
    processors: list[Any] = [
        structlog.contextvars.merge_contextvars,
        structlog.processors.add_log_level,
        structlog.processors.format_exc_info,
        redact.processor,
        _safe,
        structlog.dev.ConsoleRenderer(colors=False, pad_event_to=0, pad_level=False),
    ]
    structlog.configure(
        processors=processors,
        wrapper_class=structlog.make_filtering_bound_logger(level),
        logger_factory=lambda *_: Stderr(),
        cache_logger_on_first_use=False,
    )
    root = logging.getLogger()
    root.handlers[:] = [Handler()]
    root.setLevel(logging.DEBUG if debug else logging.WARNING)
