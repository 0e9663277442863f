"""Arguments that a tool does not take, in one line for the agent that has to correct them."""

from __future__ import annotations

from pydantic import ValidationError
from pydantic_core import ErrorDetails

_VALUE = 60  # characters of a wrong value that are repeated


def one_line(error: ValidationError) -> str:
    """Each wrong argument with its value and what is valid:

    source is 'youtub'; valid: 'youtube', 'wiki' or 'reddit'
    """
    said: dict[str, str] = {}
    # Of several ways to give an argument, what is said of a single value helps most.
    wrong = sorted(error.errors(include_url=False), key=_is_unclear)
    for one in wrong:
        name = str(one["loc"][0]) if one["loc"] else "arguments"
        value = repr(one["input"])
        value = value if len(value) <= _VALUE else f"{value[: _VALUE - 1]}…"
        if one["type"] == "missing":
            said[name] = f"{name} is missing"
        elif one["type"] == "literal_error":
            said.setdefault(name, f"{name} is {value}; valid: {one['ctx']['expected']}")
        else:
            rule = one["msg"].removeprefix("Input should be ")
            said.setdefault(name, f"{name} is {value}; valid: {rule}")
    return "; ".join(said.values())


def _is_unclear(one: ErrorDetails) -> bool:
    return one["type"] != "literal_error" or isinstance(one["input"], list)
