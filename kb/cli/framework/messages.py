"""What a command prints in addition to its data: warnings, errors, summaries.

Every line has secrets redacted, and escape sequences made harmless. Commands that a message names
are completed with the --data and --profile of this call, so that they can be typed as shown.
"""

from __future__ import annotations

import json
import logging
import re
import shlex
import sys
from collections.abc import Callable, Iterable, Sequence
from typing import TYPE_CHECKING, Any

from kb.core import terminal
from kb.core.errors import KbError, Stopped
from kb.core.progress import note_event
from kb.net import redact

if TYPE_CHECKING:  # `kb --help` loads this module
    from pathlib import Path

    from kb.core.context import Run
    from kb.core.summary import Summary

_COMMAND = re.compile(r"`kb ([^`]+)`")
# These commands have a data root of their own, or name their profile themselves.
_NOT_COMPLETED = ("demo", "sandbox", "profile")
RESTORE = "a download stays as it is; `kb restore` brings its texts back, into a data root"
_options: dict[str, str] = {}
_roots: list[Path] = []  # the data root of the command that runs now
_finders: list[Callable[[Sequence[str]], Any | None]] = []


def set_finder(finder: Callable[[Sequence[str]], Any | None]) -> None:
    """Let `find_command` ask this function: kb.cli.app imports every command, and they this."""
    _finders[:] = [finder]


def find_command(words: Sequence[str]) -> Any | None:
    """The click command that a line (without its `kb`) begins with; None where there is none."""
    return next((finder(words) for finder in _finders), None)


def set_options(data: object = None, profile: str | None = None, root: Path | None = None) -> None:
    """Remember --data and --profile of the command that runs now, and its data root."""
    _roots[:] = [root] if root else []
    options = {"--data": data, "--profile": profile}
    _options.clear()
    _options.update({name: str(value) for name, value in options.items() if value is not None})
    if ":/" in _options.get("--data", ""):  # a Path makes s3:/bucket of an address
        from kb.core.config.addresses import address_of

        _options["--data"] = address_of(_options["--data"]) or _options["--data"]


def with_options(text: str) -> str:
    """The text with --data and --profile added to each `kb …` in it."""
    return _COMMAND.sub(lambda match: f"`{complete(match[1])}`", text)


def complete(words: str) -> str:
    """A command line ("pairs --limit 3") with its `kb`, --data and --profile."""
    first = words.split()
    if first == ["restore"] and (place := _download()):
        return f"kb restore {shlex.quote(place)}"
    command = find_command(first) if _options else None
    if command is None or first[0] in _NOT_COMPLETED or "--help" in first:
        return f"kb {words}"
    known = {option for parameter in command.params for option in parameter.opts}
    missing = [
        f"{name} {shlex.quote(value)}"
        for name, value in _options.items()
        if name in known and name not in first
    ]
    return " ".join([f"kb {words}", *missing])


def advice(hint: str) -> str:
    """A hint that can be followed: of a download none that names a command which refuses one."""
    commands = (find_command(words.split()) for words in _COMMAND.findall(hint))
    writes = any(getattr(command, "data_use", "") in ("writes", "makes") for command in commands)
    return RESTORE if writes and "`kb restore`" not in hint and _download() else hint


def _download() -> str:
    """The download that this command reads, "" where it reads none."""
    from kb.artifacts.table_catalog import Catalog

    try:
        downloads = (str(root) for root in _roots if Catalog(root.absolute()).is_download)
        return next(downloads, "")
    except (KbError, OSError):  # which is no reason to fail at a message
        return ""


def fail(message: str, *, hint: str = "") -> None:
    """One line on stderr about what ended the command."""
    text = " ".join(message.split()) + (f"; {advice(hint)}" if hint else "")
    note_event(text, logging.ERROR)
    _to_stderr(f"kb: {text}")


def warn(message: str) -> None:
    """One line on stderr about something that does not end the command."""
    text = " ".join(message.split())
    note_event(text, logging.WARNING)
    _to_stderr(f"warning: {text}")


def warn_stale(run: Run) -> None:
    """One line where something that is about to be read is out of date."""
    from kb.artifacts import freshness

    if line := freshness.warning(run):
        warn(line)


def _to_stderr(text: str) -> None:
    print(terminal.one_line(redact.text(with_options(text))), file=sys.stderr, flush=True)


def show(text: str, *, err: bool = False) -> None:
    """One line of output that may hold text of others."""
    print(terminal.one_line(text), file=sys.stderr if err else sys.stdout)


def show_row(cells: Iterable[object], *, indent: str = "") -> None:
    """Cells in one line, separated by tabs."""
    print(indent + "\t".join(terminal.one_line(str(cell)) for cell in cells))


def show_list(text: str, out: Path | None, summary: Summary, as_json: bool) -> None:
    """Write a list to a file, or to stdout, which then holds it alone, ready to be redirected."""
    if out is None:
        print(text, end="")
    else:
        from kb.store.atomic import write_text

        path = out.expanduser().absolute()
        write_text(path, text)
        summary["path"] = str(path)
    if out is None and not as_json:
        print(summary.line(), file=sys.stderr)
    else:
        show_summary(summary, as_json)


def ending(error: BaseException, message: str) -> dict[str, str]:
    """What a summary says of the error that ended a command or one of its steps."""
    if isinstance(error, Stopped):
        return {"stopped": redact.text(message), "waits_for": error.waits_for}
    return {"error": redact.text(message)}


def show_summary(summary: dict[str, Any], as_json: bool) -> None:
    """What a command did, on stdout: a JSON object as the last line, or a line for a person."""
    if as_json:
        print(terminal.json(json.dumps(summary, default=str, ensure_ascii=False)), flush=True)
        return
    from kb.core.summary import Summary

    # A plan is a table of the program's own words and numbers; any other summary is one line.
    clean = terminal.lines if "phases" in summary else terminal.one_line
    print(clean(Summary(summary).line()), flush=True)
