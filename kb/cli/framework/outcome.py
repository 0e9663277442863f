"""How a run ends: one line on stderr, the summary on stdout, an exit code.

    0 done   1 failed   2 wrong usage, setting or missing part   3 stopped early, resumable

Whatever is raised ends here. The traceback is shown with --debug only, and no secret passes.
"""

from __future__ import annotations

import errno
import json
import os
import sys
import traceback
from collections.abc import Callable
from typing import Any

import typer

from kb.cli.framework.misplaced import UsageProblem, elsewhere

INTERRUPTED = 3


def guarded(run: Callable[[], Any]) -> int:
    """Call `run` and answer its exit code;
    usage errors become one line that guesses the mistake.
    """
    try:
        code = run()
    except UsageProblem as error:
        text = error.format_message().replace("?.", "?").replace("Value error, ", "")
        if error.__class__.__name__ == "NoArgsIsHelpError":
            print(text)
            return 0
        context = getattr(error, "ctx", None)
        where = context.command_path if context else "kb"
        text = text.rstrip(".")
        if text == "Missing command" and context:
            text += f": one of {', '.join(context.command.list_commands(context))}"

        complain(elsewhere(error) or text, hint=f"see `{where} --help`")
        return 2
    except typer.Abort:
        return INTERRUPTED
    except BrokenPipeError:
        _forget_stdout()
        return 0
    except Exception as error:  # noqa: BLE001  a command's file that can't even be imported
        return ending(error, debug="--debug" in sys.argv, as_json=False)
    if code == 130:  # typer's answer to a Ctrl-C that came before the command began
        return INTERRUPTED
    return code if isinstance(code, int) else 0


def ending(error: BaseException, *, debug: bool, as_json: bool) -> int:
    """Say what ended a command, and answer the exit code."""
    if isinstance(error, BrokenPipeError):
        # `kb query … | head`: the reader has what it wanted.
        _forget_stdout()
        return 0
    message, hint, code = describe(error)
    if debug:
        from kb.core import terminal

        for part in traceback.format_exception(error):
            # Frames are this program's lines; what an error says is one line of its own.
            frame = part.startswith("  ")
            shown = terminal.lines if frame else terminal.one_line
            print(shown(_redact(part.strip("\n"))), file=sys.stderr)
    summary = getattr(error, "summary", None)
    if summary is not None or as_json:
        show_summary(
            {**(summary or {}), ("stopped" if code == 3 else "error"): _redact(message)}, as_json
        )
    complain(message, hint=hint)
    return code


def describe(error: BaseException) -> tuple[str, str, int]:
    """(message, hint, exit code) of anything that can end a command."""
    from kb.core.errors import KbError

    if isinstance(error, KbError):
        return str(error), error.hint, error.exit_code
    if isinstance(error, KeyboardInterrupt):
        return "stopped", "the same command goes on where it stopped", INTERRUPTED
    if isinstance(error, OSError) and error.errno in (errno.ENOSPC, errno.EDQUOT, errno.EFBIG):
        return (
            f"no space left to write {error.filename or 'a file'}",
            "free some space; the same command goes on where it stopped",
            3,
        )
    if isinstance(error, OSError) and error.filename is not None:
        return f"{error.filename}: {error.strerror}", "", 1
    if isinstance(error, MemoryError):
        return "out of memory", "try fewer --workers", 1
    text = str(error).splitlines()[0] if str(error) else ""
    return (
        f"unexpected {type(error).__name__}: {text}",
        "run it again with --debug for the traceback",
        1,
    )


def complain(message: str, *, hint: str = "") -> None:
    """One line on stderr."""
    _say(f"kb: {' '.join(message.split())}" + (f"; {hint}" if hint else ""))


def warn(message: str) -> None:
    """One line on stderr about something that does not end the command."""
    _say(f"warning: {' '.join(message.split())}")


def _say(text: str) -> None:
    from kb.cli.framework.as_typed import as_typed
    from kb.core import terminal

    print(terminal.one_line(_redact(as_typed(text))), file=sys.stderr, flush=True)


def show_summary(summary: dict[str, Any], as_json: bool) -> None:
    """What a command did, on stdout: a JSON object as the last line, or a line for a person."""
    from kb.core import terminal

    if as_json:
        print(terminal.json(json.dumps(summary, default=str, ensure_ascii=False)), flush=True)
    else:
        from kb.core.verdict import Summary

        shown = Summary(summary)
        # A plan is a table of the program's own words and numbers; a line is one line.
        clean = terminal.lines if "phases" in shown else terminal.one_line
        print(clean(shown.line()), flush=True)


def _redact(text: str) -> str:
    from kb.net import redact

    return redact.text(text)


def _forget_stdout() -> None:
    """The reader of our pipe is gone: keep Python from complaining about it at exit."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
