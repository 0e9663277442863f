"""What the sections of a profile and the checks of a profile share."""

import re
import types
import typing
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from functools import cache
from pathlib import Path
from typing import Annotated, Any, ClassVar, NamedTuple

from pydantic import (
    AfterValidator,
    BaseModel,
    ConfigDict,
    Field,
    ValidationError,
    field_validator,
)
from pydantic.fields import FieldInfo

from kb.core import terminal
from kb.core.regular_file import read_regular
from kb.core.sources import SOURCES
from kb.core.suggestions import similar

# What `kb profile new` writes where only the user knows the value.
FILL_IN = "FILL-IN"
_MOST = 10_000_000  # bytes


class Section(BaseModel):
    """A table of the profile. Frozen, so that a run can't change its own rules.

    `table` is its name, and `about` what `kb profile new` writes above it.
    """

    table: ClassVar[str] = ""
    about: ClassVar[str] = ""

    model_config = ConfigDict(
        extra="forbid", frozen=True, str_strip_whitespace=True, allow_inf_nan=False
    )


def lies_beside(name: str, suffix: str) -> bool:
    """Whether it names a file of that kind in the profile's own folder or below."""
    return name.endswith(suffix) and not name.startswith("/") and ".." not in name.split("/")


class RecipeSection(Section):
    """The section of what a recipe makes, which may be one of the user's own
    (kb.core.config.pipeline).
    """

    pipeline: str | None = Field(
        None,
        description="your own recipe instead of the shipped one: a Python file next to the profile",
        examples=["mine.py"],
    )

    @field_validator("pipeline")
    @classmethod
    def _beside(cls, value: str | None) -> str | None:
        if value is not None and not lies_beside(value, ".py"):
            raise ValueError("must be a .py file in the profile's folder")
        return value


Remark = tuple[str, str, str, str]
"""Level, key, what is wrong, how to fix it."""


class SourceSection(RecipeSection):
    """The section of a source, in the module `section` of its package.

    `subject` is the key that says what the domain is about. `first` are the keys that stand first
    in a new profile: what to say of each, and its value there, in which {title} is the domain's
    name. A language of its texts is the field `language`, the words that show the topic a property
    `words`, and `max_age_days` the days after which the service's terms ask to read again.
    """

    subject: ClassVar[str] = ""
    first: ClassVar[Mapping[str, tuple[str, Any]]] = {}
    set_elsewhere: ClassVar[bool] = False

    def other_service(self, noted: Mapping[str, str]) -> str:
        """In words the service that data were read from, as a data root notes it, where it is
        another than this section names. `set_elsewhere`: a setting may have named it.
        """
        return ""

    def remarks(self) -> Iterator[Remark]:
        """What the types allow and is probably not meant."""
        return iter(())


def _without_empty(value: tuple[str, ...]) -> tuple[str, ...]:
    if not all(phrase.strip() for phrase in value):
        raise ValueError("contains an empty phrase")
    return value


Phrases = Annotated[tuple[str, ...], AfterValidator(_without_empty)]


ERROR = "error"  # the profile can't be used as it is
WARNING = "warning"  # it can be used, but probably does not do what was meant
NOTE = "note"  # good to know
LEVELS = (ERROR, WARNING, NOTE)


_HOST_NAME = re.compile(r"[A-Za-z0-9.-]+(:\d+)?|\[[0-9a-fA-F:]+\](:\d+)?")


def host_remarks(key: str, hosts: tuple[str, ...]) -> Iterator[Remark]:
    """What in a list is no name of a host."""
    for host in hosts:
        if not _HOST_NAME.fullmatch(host):
            what = f"'{key}' contains \"{host}\", which is not a host name"
            yield ERROR, key, what, "write a name such as images.example.org"


def repeated_remarks(key: str, words: tuple[str, ...]) -> Iterator[Remark]:
    """What stands in a list twice."""
    for word, times in Counter(word.lower() for word in words).items():
        if times > 1:
            yield WARNING, key, f"'{key}' contains \"{word}\" twice", "remove one of them"


class Finding(NamedTuple):
    """`file` is a name; `line` counts from 1, 0 for none; `key` as in `youtube.min_views`."""

    level: str
    file: str
    line: int
    key: str
    what: str
    fix: str

    @property
    def where(self) -> str:
        """profile.toml:12"""
        return f"{self.file}:{self.line}" if self.line else self.file

    def sentence(self) -> str:
        """The finding in one line."""
        return f"{self.where}: {self.what}" + (f": {self.fix}" if self.fix else "")


def worst_first(findings: list[Finding]) -> list[Finding]:
    """Errors, then warnings, then notes; each as they stand, the profile first."""

    def place(finding: Finding) -> tuple[int, bool, str, int]:
        return (
            LEVELS.index(finding.level),
            not finding.file.endswith(".toml"),
            finding.file,
            finding.line,
        )

    return sorted(findings, key=place)


UNREACHABLE, REFUSED, WRONG = 4, 1, 2  # exit codes that follow from what a service answers


class OnlineAnswer(NamedTuple):
    """What a service's answer means for the profile: a finding without its place, an exit code."""

    level: str
    key: str
    what: str
    fix: str = ""
    code: int = 0


class QuestionCost:
    """Requests and quota units of one question to a service, and the pages that it brought."""

    def __init__(self) -> None:
        self.requests = self.units = 0
        self.pages: list[str] = []

    def __str__(self) -> str:
        requests = "1 request" if self.requests == 1 else f"{self.requests} requests"
        return f"cost: {requests}, 1 search unit" if self.units else f"cost: {requests}"


Problem = tuple[str, str, str]


def problems(error: ValidationError, model: type[BaseModel]) -> list[Problem]:
    """(key, what is wrong, what is allowed) of each wrong key, in pydantic's words.

    A list whose entries are wrong is not also too short.
    """
    every = error.errors(include_url=False)
    entries = {
        detail["loc"][:-1]
        for detail in every
        if detail["loc"] and isinstance(detail["loc"][-1], int)
    }
    wrong: list[Problem] = []
    for detail in every:
        if detail["loc"] in entries:
            continue
        key, kind, value = full_key(detail["loc"] or ("profile",)), detail["type"], detail["input"]
        field = field_of(model, detail["loc"])
        about = (field and field.description) or ""
        if kind == "extra_forbidden":
            *parents, last = detail["loc"]
            inside = field_of(model, parents)
            section = model_in(inside.annotation) if inside else model
            names = set(section.model_fields) - {"path"} if section else set()
            close = similar(str(last), names, most=1, cutoff=0.5)
            fix = f"did you mean '{close[0]}'?" if close else f"known: {', '.join(sorted(names))}"
            wrong.append((key, f"unknown key '{key}'", fix))
        elif kind == "missing":
            wrong.append((key, f"'{key}' is missing", f"add a line {key} = … ({about})"))
        elif value == FILL_IN:
            key = key.partition("[")[0]
            wrong.append((key, f"'{key}' is still to be filled in", about))
        else:
            fix = detail["msg"].removeprefix("Value error, ")
            if kind == "string_pattern_mismatch":
                fix = f"must be: {about}"  # rather than a regular expression
            if isinstance(value, (dict, BaseModel)):  # a table is not shown whole
                wrong.append((key, f"'{key}': {fix}", ""))
            else:
                wrong.append((key, f"'{key}' is {terminal.shown(value)}", fix))
    return list(dict.fromkeys(wrong))


def full_key(parts: Iterable[int | str]) -> str:
    """youtube.category_ids[1]: entries of lists are counted from 1."""
    key = ""
    for part in parts:
        if isinstance(part, int):
            key += f"[{part + 1}]"
        elif part != key:  # `toxicity = "of"` is no toxicity.toxicity
            key += f".{part}" if key else part
    return key


def sources_first(names: Iterable[str]) -> list[str]:
    """Keys of a profile as people read them: the sections of sources before the others."""
    return sorted(names, key=lambda name: name not in SOURCES)


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


def is_everyday(text: str) -> bool:
    """Whether it is a single word of the list everyday_words.txt, or its plural, in any case."""
    word = text.strip().casefold()
    return any(form in _words() for form in (word, word.removesuffix("s"), word.removesuffix("es")))


@cache
def _words() -> frozenset[str]:
    text = Path(__file__).with_name("everyday_words.txt").read_text(encoding="utf-8")
    lines = (line for line in text.splitlines() if not line.startswith("#"))
    return frozenset(" ".join(lines).split())


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


def read_text(path: Path) -> str:
    """The text, of at most 10 MB, without an editor's mark at its beginning. Raises OSError,
    UnicodeDecodeError.
    """
    return read_regular(path, _MOST).decode("utf-8-sig")
