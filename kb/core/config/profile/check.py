"""Everything about a profile's file that can be known without asking anybody, all of it at once.

check_file(path)    TOML, unknown keys, wrong values, and what is allowed but can't be meant
"""

import copy
import re
import tomllib
from collections import Counter
from pathlib import Path
from typing import Any, NamedTuple

from pydantic import ValidationError

from kb.core.config.profile import Profile, plausibility
from kb.core.config.profile.base import ProfileProblem, field_of, problems
from kb.core.config.profile.check_finding import ERROR, Finding
from kb.core.config.profile.pairs import is_list_name

_AT = re.compile(r" \((?:at line (\d+), column (\d+)|at end of document)\)$")
_IN_WORDS = (  # what tomllib says, in a user's words
    ("Invalid value", "the value can't be read", 'text stands in quotes: key = "text"'),
    ("Expected '=' after", "a key and its value are expected", 'write it as key = "text"'),
    ("Cannot overwrite", "the key stands here a second time", "take one of the two lines out"),
    ("Cannot declare", "the section stands here a second time", "put its keys together"),
    ("Cannot mutate", "the section was closed before", "put its keys together"),
    ("Unclosed array", "a list is not closed", "end it with ]"),
    ("Illegal character", "a text is not closed, or holds a character that may not be there",
     "close the quotes on the same line"),
    ("Expected newline", "something stands behind the value", "one key a line; # begins a comment"),
    ("Unterminated string", "a text is not closed", "close the quotes"),
    ("Expected ']'", "a section's name is not closed", "write it as [youtube]"),
)  # fmt: skip
# What stands in for a wrong or missing key that a section can't be without, so that the rest of
# the section is looked at as well; none of them is worth a finding.
_MEANT = {"reddit.subreddit": plausibility.subreddit_meant}
_STAND_INS: dict[str, Any] = {
    "name": "unnamed",
    "title": "unnamed",
    "youtube.keywords": ["unnamed"],
    "youtube.category_ids": [20],
    "wiki.url": "http://localhost",
    "reddit.subreddit": "unnamed",
}


class Checked(NamedTuple):
    """`profile` is what could be understood, wrong keys left out; None where nothing could.

    `lists` are the names of its keyword files.
    """

    profile: Profile | None
    lists: tuple[str, ...]
    findings: list[Finding]


def check_file(path: Path, *, publishing: bool = True) -> Checked:
    """Raises nothing: a file that can't be read is a finding as well. Without `publishing` what
    only a published release needs is not looked at.
    """
    try:
        text = path.read_text(encoding="utf-8")
    except OSError as error:
        return _unread(path, "can't be read", f"{error.strerror}")
    except UnicodeDecodeError as error:
        return _unread(path, f"is not UTF-8 text (byte {error.start + 1})", "save it as UTF-8")
    try:
        data = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        named = tuple(re.findall(r'"([^"\n/]+\.tsv)"', text))
        return Checked(None, named, [_syntax(path, text, str(error))])
    except RecursionError:
        return _unread(path, "is nested too deeply", "write its tables in their own lines")
    lines = key_lines(text)

    def at(level: str, key: str, what: str, fix: str) -> Finding:
        return Finding(level, path.name, line_of(lines, key), key, what, fix)

    profile, wrong = _understand(data, path)
    findings = [at(ERROR, one.key, *_described(one, data)) for one in wrong]
    if profile is not None:
        already = {one.key for one in wrong}
        remarks = [
            *plausibility.remarks(profile, data),
            *(plausibility.publishing(profile) if publishing else ()),
        ]
        findings += [at(*one) for one in remarks if one[1] not in already]
    return Checked(profile, _lists(data), findings)


def _understand(data: dict[str, Any], path: Path) -> tuple[Profile | None, list[ProfileProblem]]:
    """The profile without its wrong keys, and what is wrong with them.

    Wrong keys hide others (a range is looked at when both ends are numbers), so it is read again
    without them until nothing is left to say.
    """
    data = copy.deepcopy(data)
    wrong: list[ProfileProblem] = []
    if data.pop("path", None) is not None:
        wrong.append(ProfileProblem("path", "unknown key 'path'", "take the line out"))
    for _ in range(20):
        try:
            return Profile(**data, path=path.resolve()), wrong
        except ValidationError as error:
            wrong += [one for one in problems(error, Profile) if one not in wrong]
            for one in error.errors(include_url=False):
                _leave_out(data, [part for part in one["loc"] if isinstance(part, str)])
    return None, wrong


def _leave_out(data: dict[str, Any], keys: list[str]) -> None:
    """Take out the key of a problem, or put in what stands for it; else the section around it."""
    while keys:
        *parents, last = keys
        table: Any = data
        for key in parents:
            table = table.get(key) if isinstance(table, dict) else None
        if isinstance(table, dict):
            removed = table.pop(last, None)
            stand_in = _STAND_INS.get(".".join(keys))
            if stand_in is not None:
                table[last] = stand_in
            if removed is not None or stand_in is not None:
                return
        keys = parents


def _described(problem: ProfileProblem, data: dict[str, Any]) -> tuple[str, str]:
    """What is wrong and how to fix it; of a whole section what is said is what is wrong."""
    if problem.what == f"'{problem.key}'":
        return problem.line(), ""
    return problem.what, _suggest_fix(problem, data)


def _suggest_fix(problem: ProfileProblem, data: dict[str, Any]) -> str:
    field = field_of(Profile, re.sub(r"\[\d+\]", "", problem.key).split("."))
    about = field.description if field is not None else None
    if problem.what.endswith("is missing"):
        return f"add a line {problem.key} = …" + (f" ({about})" if about else "")
    if problem.what.endswith("to be filled in"):
        return about or ""
    section, _, key = problem.key.partition(".")
    given = data.get(section)
    if problem.key in _MEANT and isinstance(given, dict):
        return _MEANT[problem.key](given.get(key)) or problem.fix
    return problem.fix


def _lists(data: dict[str, Any]) -> tuple[str, ...]:
    section = data.get("pairs")
    names = section.get("keyword_files") if isinstance(section, dict) else None
    if not isinstance(names, list):
        return ()
    return tuple(one for one in names if isinstance(one, str) and is_list_name(one))


def _unread(path: Path, what: str, fix: str) -> Checked:
    finding = Finding(ERROR, path.name, 0, "", f"the profile {path} {what}", fix)
    return Checked(None, (), [finding])


def _syntax(path: Path, text: str, message: str) -> Finding:
    place = _AT.search(message)
    line = int(place[1]) if place and place[1] else len(text.splitlines())
    plain = _AT.sub("", message)
    for begin, what, fix in _IN_WORDS:
        if plain.startswith(begin):
            return Finding(ERROR, path.name, line, "", f"not valid TOML: {what}", fix)
    return Finding(ERROR, path.name, line, "", f"not valid TOML: {plain}", "see https://toml.io")


# -- on which line of a TOML text a key stands; tomllib does not say -----------------------------

_PART = r"""(?:[A-Za-z0-9_-]+|"[^"]*"|'[^']*')"""
_NAME = rf"{_PART}(?:\s*\.\s*{_PART})*"
_HEADER = re.compile(rf"\s*(\[\[?)\s*({_NAME})\s*\]")
_KEY = re.compile(rf"\s*({_NAME})\s*=")


def key_lines(text: str) -> dict[str, int]:
    """Full name of every key and table to its line, counted from 1; entries of lists from [1]."""
    lines: dict[str, int] = {}
    table, tables = "", Counter[str]()
    for number, line in enumerate(text.splitlines(), start=1):
        if header := _HEADER.match(line):
            table = _unquoted(header[2])
            lines.setdefault(table, number)
            if header[1] == "[[":
                tables[table] += 1
                table = f"{table}[{tables[table]}]"
                lines.setdefault(table, number)
        elif key := _KEY.match(line):
            name = _unquoted(key[1])
            lines.setdefault(f"{table}.{name}" if table else name, number)
    return lines


def line_of(lines: dict[str, int], key: str) -> int:
    """The line of a key, else of the list or table that it stands in, else 0."""
    while key:
        if key in lines:
            return lines[key]
        inside = [line for name, line in lines.items() if name.startswith(f"{key}.")]
        if inside:  # a table that is written by dotted keys alone
            return min(inside)
        key = key.rpartition("[")[0] if key.endswith("]") else key.rpartition(".")[0]
    return 0


def _unquoted(name: str) -> str:
    return ".".join(part.strip("\"'") for part in re.findall(_PART, name))
