"""Turns whatever ends a command into an exit code and one line on stderr.

    0 done   1 failed   2 wrong usage, setting or missing part   3 stopped early, resumable

The traceback is shown with --debug only.
"""

import os
import sys
import traceback
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import typer

from kb.cli.framework.messages import fail, show_summary
from kb.cli.framework.usage_errors import UsageProblem, commands_with_option
from kb.core import terminal
from kb.core.errors import KbError
from kb.net import redact
from kb.store.full_disk import as_disk_full

INTERRUPTED = 3


def run_to_exit_code(app: Any, words: Sequence[str] | None = None) -> int:
    """Run the command line, by default the process's own, and return its exit code; a usage error
    becomes one line with a suggestion.
    """
    try:
        code = app(args=words, prog_name="kb", standalone_mode=False)
    except UsageProblem as error:
        return _usage_error(error)
    except typer.Abort:
        return INTERRUPTED
    except Exception as error:  # noqa: BLE001  a command's module may fail to import
        return report(error, debug="--debug" in sys.argv, as_json=False)
    if code == 130:  # typer's answer to a Ctrl-C that came before the command began
        return INTERRUPTED
    return code if isinstance(code, int) else 0


def _usage_error(error: Any) -> int:
    text = error.format_message().replace("?.", "?").replace("Value error, ", "")
    if error.__class__.__name__ == "NoArgsIsHelpError":
        print(text)
        return 0
    context = getattr(error, "ctx", None)
    text = text.rstrip(".")
    if text == "Missing command" and context:
        text += f": one of {', '.join(context.command.list_commands(context))}"
    path = context.command_path if context else "kb"
    fail(commands_with_option(error) or text, hint=f"see `{path} --help`")
    return 2


def report(error: BaseException, *, debug: bool, as_json: bool, places: Sequence[Path] = ()) -> int:
    """Print what ended a command, and return the exit code.

    `places`: where it may have written without saying so when there was no room.
    """
    if isinstance(error, BrokenPipeError):  # `kb query … | head`
        _discard_stdout()
        return 0
    if full := as_disk_full(error, *places):
        try:
            sys.stdout.flush()
        except OSError:
            _discard_stdout()
    message, hint, code = describe(full or error)
    if debug:
        for part in traceback.format_exception(error):
            # Frames are this program's lines; the error's own text has to stay one line.
            clean = terminal.lines if part.startswith("  ") else terminal.one_line
            print(clean(redact.text(part.strip("\n"))), file=sys.stderr)
    summary = getattr(error, "summary", None)
    if summary is not None or as_json:
        end = {("stopped" if code == INTERRUPTED else "error"): redact.text(message)}
        show_summary({**(summary or {}), **end}, as_json)
    fail(message, hint=hint)
    return code


def _discard_stdout() -> None:
    """Python complains at exit when it can't flush stdout."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def describe(error: BaseException) -> tuple[str, str, int]:
    """(message, hint, exit code) of anything that can end a command."""
    if isinstance(error, KbError):
        return str(error), error.hint, error.exit_code
    if isinstance(error, KeyboardInterrupt):
        return "stopped", "run the same command to resume", INTERRUPTED
    if isinstance(error, OSError) and error.filename is not None:
        return f"{error.filename}: {error.strerror}", "", 1
    if isinstance(error, MemoryError):
        return "out of memory", "try fewer --workers", 1
    text = str(error).splitlines()[0] if str(error) else ""
    message = f"unexpected {type(error).__name__}: {text}"
    return message, "run it again with --debug for the traceback", 1
