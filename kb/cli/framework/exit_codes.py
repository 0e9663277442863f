"""Turns whatever ends a command into an exit code and one line on stderr.

    0 done   1 failed   2 wrong usage, setting or missing part
    3 stopped early, passes with time   4 stopped early, somebody has to act

The traceback is shown with --debug only.
"""

import errno
import os
import sys
import traceback
from collections import defaultdict
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import typer

from kb.cli.framework.messages import ending, fail, show_summary
from kb.core import terminal
from kb.core.errors import Interrupted, KbError, Stopped
from kb.net import redact
from kb.store.exhausted import HINT, as_disk_full, is_out_of_memory

UNWRITABLE = "name a --data that you may write to, or change who may"


def run_to_exit_code(app: Any, words: Sequence[str] | None = None) -> int:
    """Run the command line, by default the process's own, and return its exit code; a usage error
    becomes one line with a suggestion.
    """
    try:
        code = app(args=words, prog_name="kb", standalone_mode=False)
    except UsageProblem as error:
        return _usage_error(error)
    except typer.Abort:
        return Interrupted.exit_code
    except Exception as error:  # noqa: BLE001  a command's module may fail to import
        return report(error, debug="--debug" in sys.argv, as_json=False)
    if code == 130:  # typer's answer to a Ctrl-C that came before the command began
        return Interrupted.exit_code
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
    if isinstance(error, KeyboardInterrupt):
        trace = error.__traceback__
        error = Interrupted("stopped", hint="run the same command to resume").with_traceback(trace)
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
        show_summary({**(summary or {}), **ending(full or error, message)}, as_json)
    fail(message, hint=hint)
    return code


def _discard_stdout() -> None:
    """Python complains at exit when it can't flush stdout."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def describe(error: BaseException) -> tuple[str, str, int]:
    """(message, hint, exit code) of anything that can end a command; notes say on which machine."""
    notes = "".join(f" ({note})" for note in getattr(error, "__notes__", ()))
    if not isinstance(error, Stopped) and is_out_of_memory(error):
        return f"out of memory{notes}", HINT, 1
    if isinstance(error, KbError):
        return f"{error}{notes}", error.hint, error.exit_code
    if isinstance(error, OSError) and error.filename is not None:
        hint = UNWRITABLE if error.errno in (errno.EROFS, errno.EACCES, errno.EPERM) else ""
        return f"{error.filename}: {error.strerror}{notes}", hint, 1
    from kb.core.config.pipeline import own_place

    text = str(error).splitlines()[0] if str(error) else ""
    own = own_place(error)
    where = f"the recipe {own}:" if own else "unexpected"
    message = f"{where} {type(error).__name__}: {text}{notes}"
    return message, "run it again with --debug for the traceback", 1


# typer carries its own copy of click; its usage errors are reached through a public name.
UsageProblem: Any = typer.BadParameter.__mro__[1]

_MOST_NAMES = 3  # commands that a message names
_SIMILAR = 0.8  # difflib's ratio from which a word counts as a misspelling


def refuse_unknown(group: Any, context: Any, args: Sequence[str]) -> None:
    """Raise a usage error with suggestions unless the first word names a command of `group`."""
    if not args or args[0].startswith("-") or group.get_command(context, args[0]) is not None:
        return
    words = [*context.command_path.split()[1:], args[0]]
    if len(words) == 1 and args[1:] and args[1].replace("-", "").isalpha():
        words.append(args[1])
    names = suggestions(words, [name for name, _ in context.find_root().command.leaves()])
    guess = f"; did you mean {_join([f'kb {name}' for name in names], 'or')}?" if names else ""
    raise UsageProblem(f"there is no command `kb {' '.join(words)}`{guess}", context)


def refuse_options_before_command(context: Any, command: str) -> None:
    """Raise a usage error for an option of a group that is given before one of its commands."""
    for parameter in context.command.params:
        source = context.get_parameter_source(parameter.name)
        if source is not None and source.name == "COMMANDLINE":
            option = parameter.opts[0]
            path = f"{context.command_path} {command} {option}"
            raise UsageProblem(f"put {option} after `{command}`: `{path} …`", context)


def suggestions(words: Sequence[str], commands: Sequence[str]) -> list[str]:
    """The commands ("youtube crawl") that are most like the words.

    Several words are compared in any order ("crawl youtube", "youtube-crawl", "youtube crwal"); a
    single one with a command's last word ("export", "exprot").
    """
    from kb.core.suggestions import similar

    parts = sorted(part for word in words for part in word.split("-") if part)
    by_words, by_last_word = defaultdict[str, list[str]](list), defaultdict[str, list[str]](list)
    for name in commands:
        by_words[" ".join(sorted(name.split()))].append(name)
        by_last_word[name.rsplit(maxsplit=1)[-1]].append(name)
    near_all = [by_words[known] for known in similar(" ".join(parts), by_words, 1, _SIMILAR)]
    near_last = [
        by_last_word[known] for part in parts for known in similar(part, by_last_word, 1, _SIMILAR)
    ]
    near = near_all + near_last if len(parts) > 1 else near_last + near_all
    return next(iter(near), [])


def commands_with_option(error: Any) -> str:
    """A message for an unknown option that other commands have; "" where none has it."""
    option, context = getattr(error, "option_name", None), getattr(error, "ctx", None)
    if option is None or context is None:
        return ""
    here = context.command_path
    having = [
        f"kb {path}"
        for path, command in context.find_root().command.leaves()
        if any(option in parameter.opts for parameter in command.params)
    ]
    siblings = [path for path in having if path.split()[:2] == here.split()[:2]]
    names = siblings or having
    return f"`{here}` has no {option}; it is an option of {_join(names, 'and')}" if names else ""


def _join(names: Sequence[str], last: str) -> str:
    quoted = [f"`{name}`" for name in names]
    if len(quoted) > _MOST_NAMES:
        quoted[_MOST_NAMES:] = [f"{len(quoted) - _MOST_NAMES} more"]
    return f" {last} ".join(filter(None, [", ".join(quoted[:-1]), quoted[-1]]))
