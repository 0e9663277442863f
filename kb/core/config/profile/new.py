"""The files of a new profile, made from the declarations in this folder: every key, its default,
what it is for and what it may be. What only the user knows stands first.

profile_text("rock-gardens")            profile.toml of a new domain
profile_text("mine", source=profile)    the same with another profile's values
KEYWORDS                                keywords.tsv, with its columns and rules
"""

import json
import re
import textwrap
import typing
from collections.abc import Iterator, Mapping
from typing import Any

from annotated_types import Ge, Gt, Le, Lt
from pydantic import BaseModel
from pydantic.fields import FieldInfo

from kb.core.config.profile import Profile
from kb.core.config.section import FILL_IN, model_in, sources_first
from kb.core.sources import SOURCES

_WIDTH = 98
# What only the owner of a release can say of it.
OWNERS = ("release.licenses", "release.creators", "release.contact")
_SECTIONS = {name: model_in(Profile.model_fields[name].annotation) for name in SOURCES}
# What stands first: what to say of it, and its value. Of a source that is not collected, the line
# goes.
_FIRST: dict[str, tuple[str, Any]] = {
    "title": ("The domain's name for people, as cards and reports bear it.", "{title}"),
    **{
        f"{name}.{key}": first
        for name, section in _SECTIONS.items()
        for key, first in getattr(section, "first", {}).items()
    },
    "pairs.keyword_files": (
        "Words that are matched in transcripts, in the file beside this one.",
        ["keywords.tsv"],
    ),
}
_HEAD = """\
# The profile of {title}: everything that Lorecrawl knows about the domain.
#
# A line that begins with # and a key shows its default: take the # away to change it.
# Keys stand by their full names, as messages name them.{marked}
# `kb profile check` says what is missing or wrong.

# ---- First
"""
_MARKED = f"""
# {FILL_IN} marks what only you know. A source that you don't collect: take its line out."""

KEYWORDS = f"""\
# Words that are matched in transcripts, one a line; columns are separated by tabs.
#
#   keyword   as people know it: Rock Garden. Plurals and joined forms (rock gardens, rockgarden)
#             follow by rule; case and hyphens make no difference.
#   kind      a word of your own that sorts keywords: plant, tool, place …
#   rule      nothing where the word is your domain's alone. For everyday words (bed, spring):
#               topic     counts in videos that YouTube's label says are about your domain, or that
#                         you imported with imported_topic = "known"; elsewhere like near
#               near      counts when a keyword without a rule is near (pairs.near_words)
#               near:30   the same within 30 words
#               never     is counted, and makes no pair
#               always    counts wherever it is said, as without a rule: you mean this everyday word
#   forms     other words for the same, separated by commas
#
# For example, with tabs in between:
#   Secateurs       tool                    pruning shears, pruners
#   Bed             place       near        flower bed
#
# `kb profile check --data DIR` shows what each would hit in transcripts that you have.
keyword\tkind\trule\tforms
{FILL_IN}\tkind
"""


_NONE: Mapping[str, Any] = {}


def profile_text(
    name: str,
    *,
    values: Mapping[str, Any] = _NONE,
    source: Profile | None = None,
) -> str:
    """The text of a profile.toml named `name`. `values`, by full names of keys, win over the
    source's. Who releases the data, and under which licence, is copied from no shipped profile.
    """
    if source:
        title, known = source.title, dict(_values("", source))
        if source.is_shipped:
            known = {key: value for key, value in known.items() if key not in OWNERS}
    else:
        title = " ".join(part.capitalize() for part in re.split("[-_]+", name))
        known = {key: _filled(value, title) for key, (_, value) in _FIRST.items()}
    known |= {**values, "name": name}
    marked = _MARKED if FILL_IN in json.dumps(list(known.values()), default=str) else ""
    parts = [_HEAD.format(title=title, marked=marked), f"name = {_toml(name)}\n"]
    for key, (about, _) in _FIRST.items():
        if key in known:
            parts.append(f"\n{_comment(about)}{key} = {_toml(known[key])}\n")
        elif key != "pairs.keyword_files":
            parts.append(f"\n{_comment(about)}#{key} = {_toml(FILL_IN)}\n")
    parts.append("\n# ---- Random choices\n" + "".join(_keys("", Profile, known)))
    for section in sources_first(Profile.model_fields):
        inner = model_in(Profile.model_fields[section].annotation)
        if inner is not None:
            head = _comment(f"---- {getattr(inner, 'about', section)}")
            parts.append(f"\n{head}" + "".join(_keys(section, inner, known)))
    return "".join(parts)


def _filled(value: Any, title: str) -> Any:
    if isinstance(value, list):
        return [_filled(entry, title) for entry in value]
    return value.replace("{title}", title) if isinstance(value, str) else value


def _values(prefix: str, section: BaseModel) -> Iterator[tuple[str, Any]]:
    """Every value of a profile that is no default, by its full name."""
    for name, field in type(section).model_fields.items():
        value, key = getattr(section, name), f"{prefix}{name}"
        if name == "path" or value is None:
            continue
        if isinstance(value, BaseModel):
            yield from _values(f"{key}.", value)
        elif field.is_required() or value != field.get_default(call_default_factory=True):
            yield key, value


def _keys(prefix: str, section: type[BaseModel], known: Mapping[str, Any]) -> Iterator[str]:
    """The lines of a section: those that were not first."""
    deeper = []
    for name, field in section.model_fields.items():
        key = f"{prefix}.{name}" if prefix else name
        inner = model_in(field.annotation)
        listed = typing.get_origin(field.annotation) in (tuple, dict)
        if inner is not None and not listed:
            deeper.append((key, inner))
        elif name != "path" and key not in ("name", *_FIRST):
            yield from _key(key, field, known)
    if prefix:
        for key, inner in deeper:
            yield from _keys(key, inner, known)


def _key(key: str, field: FieldInfo, known: Mapping[str, Any]) -> Iterator[str]:
    """A key with what it is for; behind # where it has its default."""
    default = field.get_default(call_default_factory=True)
    value = known.get(key, default)
    is_set = value is not None and not (value == {} and field.examples)
    allowed = _allowed(field, value) if is_set else "not set"
    yield "\n" + _comment("; ".join(filter(None, [field.description, allowed])))
    sign = "" if key in known else "#"
    if not is_set:
        value = _example(field)
    if not isinstance(value, dict):
        yield _behind(sign, f"{key} = {_toml(value)}")
        return
    if not value:
        yield _behind(sign, f"{key} = {{}}")
    for name, inner in value.items():
        bare = name if re.fullmatch(r"[A-Za-z0-9_-]+", name) else json.dumps(name)
        yield _behind(sign, f"{key}.{bare} = {_toml(inner)}")


def _allowed(field: FieldInfo, value: Any) -> str:
    """The limits of a value, or the words that it is one of."""
    if typing.get_origin(field.annotation) is typing.Literal:
        return "one of " + ", ".join(
            json.dumps(choice) for choice in typing.get_args(field.annotation)
        )
    if isinstance(value, dict) and value:
        return "change all of these lines or none"
    lines = []
    for rule in field.metadata:
        for kind, name, words in (
            (Ge, "ge", "at least"),
            (Gt, "gt", "more than"),
            (Le, "le", "at most"),
            (Lt, "lt", "less than"),
        ):
            if isinstance(rule, kind):
                lines.append(f"{words} {getattr(rule, name):,}")
    return ", ".join(lines)


def _example(field: FieldInfo) -> Any:
    """What a key that is not set may be."""
    if field.examples:
        return field.examples[0]
    kinds = typing.get_args(field.annotation)
    return "…" if str in kinds else 30 if int in kinds else 0.5


def _toml(value: Any) -> str:
    if isinstance(value, BaseModel):
        values = value.model_dump(exclude_none=True)
        return "{ " + ", ".join(f"{name} = {_toml(entry)}" for name, entry in values.items()) + " }"
    if isinstance(value, (list, tuple)):
        inner = [_toml(entry) for entry in value]
        line = f"[{', '.join(inner)}]"
        return (
            line if len(line) <= 70 else "[\n" + "".join(f"  {entry},\n" for entry in inner) + "]"
        )
    if isinstance(value, (str, bool)):
        return json.dumps(value, ensure_ascii=False)
    return str(value)


def _comment(text: str) -> str:
    lines = textwrap.wrap(text, _WIDTH, break_long_words=False, break_on_hyphens=False)
    return "".join(f"# {line}\n" for line in lines)


def _behind(sign: str, text: str) -> str:
    return "".join(f"{sign}{line}\n" for line in text.splitlines())
