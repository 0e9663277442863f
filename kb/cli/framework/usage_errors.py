"""Wrong commands and options: what the user probably meant."""

import difflib
from collections.abc import Sequence
from typing import Any

import typer

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
    parts = sorted(part for word in words for part in word.split("-") if part)

    def by_all_words(name: str) -> float:
        return _similarity(" ".join(parts), " ".join(sorted(name.split())))

    def by_last_word(name: str) -> float:
        return max((_similarity(part, name.rsplit(maxsplit=1)[-1]) for part in parts), default=0)

    for measure in (by_all_words, by_last_word) if len(parts) > 1 else (by_last_word, by_all_words):
        scores = {name: measure(name) for name in commands}
        best = max(scores.values())
        if best >= _SIMILAR:
            return [name for name in commands if scores[name] == best]
    return []


def _similarity(one: str, other: str) -> float:
    return difflib.SequenceMatcher(None, one, other).ratio()


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
