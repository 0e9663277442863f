"""Commands that a message names, completed to what has to be typed here.

That is with the --data and --profile of this call.
"""

from __future__ import annotations

import re
import shlex

_COMMAND = re.compile(r"`kb ([^`]+)`")
# Their data root is not the one that the message is about, or they name their profile themselves.
_OWN_PLACE = ("demo", "sandbox", "profile")
_given: dict[str, str] = {}


def begin(data: object = None, profile: str | None = None) -> None:
    """Remember the data root and the profile that the command which runs now was called with."""
    given = {"--data": data, "--profile": profile}
    _given.clear()
    _given.update({name: str(value) for name, value in given.items() if value is not None})


def as_typed(text: str) -> str:
    """The text with each `kb …` in it completed."""
    return _COMMAND.sub(lambda match: f"`{completed(match[1])}`", text)


def completed(words: str) -> str:
    """A command without its `kb`, as it has to be typed here."""
    return f"kb {_completed(words)}" if _given else f"kb {words}"


def _completed(words: str) -> str:
    from kb.cli.app import named

    first = words.split()
    command = named(first)
    if command is None or first[0] in _OWN_PLACE or "--help" in first:
        return words
    known = {option for parameter in command.params for option in parameter.opts}
    missing = [
        f"{name} {shlex.quote(value)}"
        for name, value in _given.items()
        if name in known and name not in first
    ]
    return " ".join([words, *missing])
