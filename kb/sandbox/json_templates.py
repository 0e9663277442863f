"""Fills in the answers in data/, which have the form of recorded ones with names for values.

`$name` in a text is the value as text. A text that is nothing else is the value itself, of whatever
type; a field whose value is None is left out.
"""

import json
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from string import Template
from typing import Any

_DATA = Path(__file__).with_name("data")


def written(file: str, name: str, values: Mapping[str, Any]) -> Any:
    """The answer `name` of a file below data/, with the values in their places."""
    return _filled(_answers(file)[name], values)


@cache
def _answers(file: str) -> dict[str, Any]:
    return json.loads((_DATA / file).read_text(encoding="utf-8"))


def _filled(part: Any, values: Mapping[str, Any]) -> Any:
    if isinstance(part, dict):
        filled = {name: _filled(inner, values) for name, inner in part.items()}
        return {name: value for name, value in filled.items() if value is not None}
    if isinstance(part, list):
        return [_filled(inner, values) for inner in part]
    if not isinstance(part, str):
        return part
    if part.startswith("$") and part[1:] in values:
        return values[part[1:]]
    return Template(part).substitute(values)
