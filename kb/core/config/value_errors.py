"""What the validation library found wrong with a value, in a user's words.

wrong(problem, field)   "must be a list, such as [\"Minecraft\"]"
shown(value)            the value as it would be written in a profile, shortened
"""

import json
from typing import Any

from pydantic.fields import FieldInfo

_LONGEST = 60  # characters of a value in a message

# Types of problems as pydantic names them; {…} are what it says about them.
_WORDS = {
    "string_type": "must be text in quotes",
    "string_too_short": "must not be empty",
    "int_type": "must be a whole number",
    "int_parsing": "must be a whole number",
    "int_parsing_size": "is too large a number",
    "int_from_float": "must be a whole number",
    "float_type": "must be a number",
    "float_parsing": "must be a number",
    "finite_number": "must be a finite number",
    "bool_type": "must be true or false",
    "bool_parsing": "must be true or false",
    "tuple_type": "must be a list in brackets",
    "list_type": "must be a list in brackets",
    "dict_type": "must be a table of its own, with keys and values",
    "model_type": "must be a table of its own, with keys and values",
    "model_attributes_type": "must be a table of its own, with keys and values",
    "too_short": "must hold at least {min_length}",
    "too_long": "must hold at most {max_length}",
    "greater_than": "must be more than {gt}",
    "greater_than_equal": "must be at least {ge}",
    "less_than": "must be less than {lt}",
    "less_than_equal": "must be at most {le}",
    "literal_error": "must be one of {expected}",
    "enum": "must be one of {expected}",
    "path_type": "must be a path",
}
_EXAMPLES = {
    "int_type": "100",
    "int_parsing": "100",
    "int_from_float": "100",
    "float_type": "1.5",
    "float_parsing": "1.5",
    "bool_type": "true",
    "bool_parsing": "true",
}


def wrong(problem: Any, field: FieldInfo | None) -> str:
    """What is expected, with an example: the field's own, or one made of what was given."""
    kind = problem["type"]
    if kind in ("value_error", "assertion_error"):
        message = str(problem["msg"]).removeprefix("Value error, ")
        return message + _such_as(_own_example(field))
    if kind == "string_pattern_mismatch" and field is not None:
        return f"must be: {field.description}" + _such_as(_own_example(field))
    words = _WORDS.get(kind)
    if words is None:
        message = str(problem["msg"])
        return message[:1].lower() + message[1:]
    context = {name: _plain(value) for name, value in problem.get("ctx", {}).items()}
    return words.format_map(context) + _such_as(
        _own_example(field) or _EXAMPLES.get(kind) or _as_wanted(kind, problem.get("input"))
    )


def shown(value: Any) -> str:
    """As in TOML, cut where it is long."""
    if isinstance(value, (str, bool, list, tuple)):
        text = json.dumps(value, ensure_ascii=False, default=str)
    else:
        text = str(value)
    return text if len(text) <= _LONGEST else text[: _LONGEST - 1] + "…"


def _own_example(field: FieldInfo | None) -> str:
    return shown(field.examples[0]) if field is not None and field.examples else ""


def _as_wanted(kind: str, given: Any) -> str:
    """What was given, put into the form that was asked for."""
    if kind in ("tuple_type", "list_type") and isinstance(given, (str, int, float)):
        return shown([given])
    if kind == "string_type" and isinstance(given, (int, float)):
        return shown(str(given))
    return ""


def _such_as(example: str) -> str:
    return f", such as {example}" if example else ""


def _plain(value: Any) -> Any:
    return int(value) if isinstance(value, float) and value.is_integer() else value
