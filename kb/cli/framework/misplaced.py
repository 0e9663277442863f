"""Commands and options that a command line puts in the wrong place: what it may mean instead."""

from __future__ import annotations

import difflib
from collections.abc import Sequence
from typing import Any

import typer

# typer carries its own copy of click; its usage errors are reached through a public name.
UsageProblem: Any = typer.BadParameter.__mro__[1]

_NAMED = 3  # commands in the message; of more the first ones are
_CLOSE = 0.8  # similarity from which a word is taken for a misspelt one (difflib's ratio)


def refuse_unknown(group: Any, context: Any, args: Sequence[str]) -> None:
    """Raise the usage error for a first word that is no command of `group`, with suggestions."""
    if not args or args[0].startswith("-") or group.get_command(context, args[0]) is not None:
        return
    words = [*context.command_path.split()[1:], args[0]]
    if len(words) == 1 and args[1:] and args[1].replace("-", "").isalpha():
        words.append(args[1])
    names = suggestions(words, [name for name, _ in context.find_root().command.leaves()])
    meant = f"; did you mean {_listed([f'kb {name}' for name in names], 'or')}?" if names else ""
    raise UsageProblem(f"there is no command `kb {' '.join(words)}`{meant}", context)


def suggestions(words: Sequence[str], commands: Sequence[str]) -> list[str]:
    """The commands ("youtube crawl") that the words may mean, the nearest rule first:

    - its words in another order or joined as in its make target: "crawl youtube", "youtube-crawl"
    - misspelt: "youtube crwal"
    - commands of that name in other groups: "export", "wiki import"
    - a misspelt name of these: "exprot"
    """
    parts = [part for word in words for part in word.split("-") if part] or [""]
    same = [name for name in commands if sorted(name.split()) == sorted(parts)]
    if same:
        return same
    if len(parts) > 1:
        lines = " ".join(parts), " ".join(reversed(parts))
        score = {name: max(_similarity(line, name) for line in lines) for name in commands}
        best = max(score.values())
        if best >= _CLOSE:
            return [name for name in commands if score[name] == best]
    verbs = [name.split()[-1] for name in commands]
    near = difflib.get_close_matches(parts[0], set(verbs), n=1, cutoff=_CLOSE)
    groups = {name.split()[0] for name in commands}
    for wanted in (*(part for part in parts if part not in groups), *near):
        named = [name for name, verb in zip(commands, verbs, strict=True) if verb == wanted]
        if named:
            return named
    return []


def _similarity(one: str, other: str) -> float:
    return difflib.SequenceMatcher(None, one, other).ratio()


def elsewhere(error: Any) -> str:
    """What to say of an unknown option that other commands have; "" where none has it."""
    option, context = getattr(error, "option_name", None), getattr(error, "ctx", None)
    if option is None or context is None:
        return ""
    here = context.command_path
    having = [
        f"kb {path}"
        for path, command in context.find_root().command.leaves()
        if any(option in parameter.opts for parameter in command.params)
    ]
    group = " ".join(here.split()[:2])
    near = [path for path in having if path.split()[:2] == group.split()]
    names = near or having
    if not names:
        return ""
    return f"`{here}` has no {option}; it is an option of {_listed(names, 'and')}"


def _listed(names: Sequence[str], last: str) -> str:
    quoted = [f"`{name}`" for name in names]
    if len(quoted) > _NAMED:
        return ", ".join(quoted[:_NAMED]) + f" {last} {len(quoted) - _NAMED} more"
    return f" {last} ".join(filter(None, [", ".join(quoted[:-1]), quoted[-1]]))
