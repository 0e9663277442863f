"""What all sections of a profile share: unknown keys are errors, and errors guess the mistake."""

import difflib
import re
import types
import typing
from typing import Annotated, Any, ClassVar, NamedTuple

from pydantic import AfterValidator, BaseModel, ConfigDict, ValidationError
from pydantic.fields import FieldInfo

from kb.core.config import value_errors

# What `kb profile new` writes where only the user knows the value.
FILL_IN = "FILL-IN"


class Section(BaseModel):
    """A table of the profile. Frozen, so that a run can't change its own rules.

    `table` is its name, and `about` what `kb profile new` writes above it.
    """

    table: ClassVar[str] = ""
    about: ClassVar[str] = ""

    model_config = ConfigDict(
        extra="forbid", frozen=True, str_strip_whitespace=True, allow_inf_nan=False
    )


def _without_empty(value: tuple[str, ...]) -> tuple[str, ...]:
    if not all(phrase.strip() for phrase in value):
        raise ValueError("holds an empty phrase")
    return value


Phrases = Annotated[tuple[str, ...], AfterValidator(_without_empty)]


class ProfileProblem(NamedTuple):
    """One wrong key: its full name, what is wrong with it and how it is mended."""

    key: str
    what: str
    fix: str = ""
    joint: str = ": "

    def line(self) -> str:
        """In one sentence."""
        return f"{self.what}{self.joint}{self.fix}" if self.fix else self.what


def explain(error: ValidationError, model: type[BaseModel]) -> str:
    """All problems of a profile in one line: key, what was found, what is allowed, a guess."""
    return "; ".join(problem.line() for problem in problems(error, model))


def problems(error: ValidationError, model: type[BaseModel]) -> list[ProfileProblem]:
    """The same one by one. A list whose entries are wrong is not also too short."""
    every = error.errors(include_url=False)
    entries = {one["loc"][:-1] for one in every if one["loc"] and isinstance(one["loc"][-1], int)}
    lines = [_problem(one, model) for one in every if one["loc"] not in entries]
    return list(dict.fromkeys(lines))


def _problem(problem: Any, model: type[BaseModel]) -> ProfileProblem:
    *parents, last = problem["loc"] or ("profile",)
    key = _key(problem["loc"])
    kind = problem["type"]
    if kind == "extra_forbidden":
        names = _fields(model, parents)
        close = difflib.get_close_matches(str(last), names, n=1, cutoff=0.5)
        if close:
            return ProfileProblem(key, f"unknown key '{key}'", f"did you mean '{close[0]}'?", ", ")
        return ProfileProblem(
            key, f"unknown key '{key}'", f"known keys: {', '.join(sorted(names))}", "; "
        )
    if kind == "missing":
        return ProfileProblem(key, f"'{key}' is missing")
    allowed = problem.get("ctx", {}).get("expected", "")
    value = problem.get("input")
    if value == FILL_IN:
        key = key.partition("[")[0]
        return ProfileProblem(key, f"'{key}' is still to be filled in")
    field = field_of(model, problem["loc"])
    # A table is not shown whole: what is wrong in it is said.
    given = "" if isinstance(value, (dict, BaseModel)) else f" is {value_errors.shown(value)}"
    fix = value_errors.wrong(problem, field)
    if kind == "literal_error" and isinstance(value, str):
        close = difflib.get_close_matches(
            value, [part.strip("' ") for part in allowed.replace(" or ", ",").split(",")], n=1
        )
        fix += f" (did you mean {close[0]!r}?)" if close else ""
    return ProfileProblem(key, f"'{key}'{given}", fix)


def _key(parts: Any) -> str:
    """youtube.category_ids[1]: entries of lists are counted from 1."""
    key = ""
    for part in parts:
        if isinstance(part, int):
            key += f"[{part + 1}]"
        elif part != key:  # `toxicity = "of"` is no toxicity.toxicity
            key += f".{part}" if key else str(part)
    return key


def field_of(model: type[BaseModel], parts: Any) -> FieldInfo | None:
    """The field of a key, where it is one."""
    field: FieldInfo | None = None
    inner: type[BaseModel] | None = model
    for part in parts:
        if isinstance(part, int):
            continue
        field = inner.model_fields.get(str(part)) if inner is not None else None
        inner = model_in(field.annotation) if field is not None else None
    return field


def _fields(model: type[BaseModel], parents: list[Any]) -> list[str]:
    """The keys allowed where an unknown one was found."""
    inner: type[BaseModel] | None = model
    if any(isinstance(part, str) for part in parents):
        field = field_of(model, parents)
        inner = model_in(field.annotation) if field is not None else None
    return [name for name in inner.model_fields if name != "path"] if inner is not None else []


def model_in(annotation: Any) -> type[BaseModel] | None:
    """The section inside a type, alone or in a list, a table or an alternative."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return annotation
    if typing.get_origin(annotation) in (typing.Union, types.UnionType, tuple, list, dict):
        for inner in typing.get_args(annotation):
            model = model_in(inner)
            if model is not None:
                return model
    return None


# Hosts of RFC 2606 and RFC 6761, which nobody can own.
_HOST = re.compile(
    r"(?:[@/.]|^)(?:example\.(?:com|org|net|edu)|(?:[\w-]+\.)*(?:example|invalid|test|localhost))"
    r"(?![\w.-]*\w)",
    re.IGNORECASE,
)
_NAME = re.compile(r"\b(?:you|your[-_.]?\w+|someone)@", re.IGNORECASE)


def is_placeholder(contact: str) -> bool:
    """Whether it is an example's address (example.org, you@…, FILL-IN, …invalid)."""
    return FILL_IN in contact or bool(_HOST.search(contact) or _NAME.search(contact))
