"""What all sections of a profile share: unknown keys are errors, and errors guess the mistake."""

from __future__ import annotations

import difflib
import types
import typing
from typing import Any

from pydantic import BaseModel, ConfigDict, ValidationError
from pydantic.fields import FieldInfo

from kb.core import wording


class Section(BaseModel):
    """A table of the profile. Frozen, so that a run can't change its own rules."""

    model_config = ConfigDict(
        extra="forbid", frozen=True, str_strip_whitespace=True, allow_inf_nan=False
    )


def explain(error: ValidationError, model: type[BaseModel]) -> str:
    """All problems of a profile in one line: key, what was found, what is allowed, a guess."""
    return "; ".join(_problem(problem, model) for problem in error.errors(include_url=False))


def _problem(problem: Any, model: type[BaseModel]) -> str:
    *parents, last = problem["loc"] or ("profile",)
    key = _key(problem["loc"])
    kind = problem["type"]
    if kind == "extra_forbidden":
        names = list(_fields(model, parents))
        close = difflib.get_close_matches(str(last), names, n=1, cutoff=0.5)
        return f"unknown key '{key}'" + (
            f", did you mean '{close[0]}'?"
            if close
            else f"; known keys: {', '.join(sorted(names))}"
        )
    if kind == "missing":
        return f"'{key}' is missing"
    allowed = problem.get("ctx", {}).get("expected", "")
    found = problem.get("input")
    field = _field(model, problem["loc"])
    # A table is not shown whole: what is wrong in it is said.
    given = "" if isinstance(found, (dict, BaseModel)) else f" is {wording.shown(found)}"
    line = f"'{key}'{given}: {wording.wrong(problem, field)}"
    if kind == "literal_error" and isinstance(found, str):
        close = difflib.get_close_matches(
            found, [part.strip("' ") for part in allowed.replace(" or ", ",").split(",")], n=1
        )
        line += f" (did you mean {close[0]!r}?)" if close else ""
    return line


def _key(parts: Any) -> str:
    """youtube.category_ids[1]: entries of lists are counted from 1."""
    key = ""
    for part in parts:
        if isinstance(part, int):
            key += f"[{part + 1}]"
        elif part != key:  # `toxicity = "of"` is no toxicity.toxicity
            key += f".{part}" if key else str(part)
    return key


def _field(model: type[BaseModel], parts: Any) -> FieldInfo | None:
    """The field of a key, where it is one."""
    field: FieldInfo | None = None
    inner: type[BaseModel] | None = model
    for part in parts:
        if isinstance(part, int):
            continue
        field = inner.model_fields.get(str(part)) if inner is not None else None
        inner = _model_in(field.annotation) if field is not None else None
    return field


def _fields(model: type[BaseModel], parents: list[Any]) -> dict[str, Any]:
    """The keys allowed where an unknown one was found."""
    for part in parents:
        if isinstance(part, int):
            continue
        field = model.model_fields.get(str(part))
        if field is None:
            return {}
        inner = _model_in(field.annotation)
        if inner is None:
            return {}
        model = inner
    return {name: field for name, field in model.model_fields.items() if name != "path"}


def _model_in(annotation: Any) -> type[BaseModel] | None:
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return annotation
    if typing.get_origin(annotation) in (typing.Union, types.UnionType, tuple, list, dict):
        for inner in typing.get_args(annotation):
            found = _model_in(inner)
            if found is not None:
                return found
    return None
