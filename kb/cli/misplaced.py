"""An option that a command does not have: which commands do."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

_NAMED = 3  # commands in the message; of more the first ones are


def elsewhere(error: Any) -> str:
    """What to say of an unknown option that other commands have; "" where none has it."""
    from kb.cli.app import leaves

    option, context = getattr(error, "option_name", None), getattr(error, "ctx", None)
    if option is None or context is None:
        return ""
    here = context.command_path
    having = [
        f"kb {path}"
        for path, command in leaves()
        if any(option in parameter.opts for parameter in command.params)
    ]
    group = " ".join(here.split()[:2])
    near = [path for path in having if path.split()[:2] == group.split()]
    names = near or having
    if not names:
        return ""
    return f"`{here}` has no {option}; it is an option of {_listed(names)}"


def _listed(names: Sequence[str]) -> str:
    quoted = [f"`{name}`" for name in names]
    if len(quoted) > _NAMED:
        return ", ".join(quoted[:_NAMED]) + f" and {len(quoted) - _NAMED} more"
    return " and ".join(filter(None, [", ".join(quoted[:-1]), quoted[-1]]))
