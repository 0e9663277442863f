"""Everything about a profile's file that can be known without asking anybody, all of it at once:
TOML, unknown keys, wrong values, and what is allowed but probably not meant.
"""

import contextlib
import copy
import re
import tomllib
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

from pydantic import ValidationError

from kb.core.config.addresses import is_contact
from kb.core.config.pipeline import own
from kb.core.config.profile import Profile, load_profile, shipped_names
from kb.core.config.section import (
    ERROR,
    FILL_IN,
    NOTE,
    WARNING,
    Finding,
    Problem,
    Remark,
    is_everyday,
    is_placeholder,
    lies_beside,
    problems,
    read_text,
    repeated_remarks,
)
from kb.core.errors import ProfileError
from kb.core.installation import folder
from kb.core.licences import KNOWN
from kb.core.sources import SOURCES, made_of


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

    def unread(what: str, fix: str = "", line: int = 0, lists: tuple[str, ...] = ()) -> Checked:
        return Checked(None, lists, [Finding(ERROR, path.name, line, "", what, fix)])

    try:
        text = read_text(path)
    except OSError as error:
        return unread(f"the profile {path} can't be read", f"{error.strerror}")
    except UnicodeDecodeError as error:
        what = f"the profile {path} is not UTF-8 text (byte {error.start + 1})"
        return unread(what, "save it as UTF-8")
    try:
        data = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        place = re.search(r"at line (\d+)", str(error))
        line = int(place[1]) if place else len(text.splitlines())
        lists = tuple(re.findall(r'"([^"\n/]+\.tsv)"', text))
        return unread(f"not valid TOML: {error}", "see https://toml.io", line, lists)
    except RecursionError:
        return unread(f"the profile {path} is nested too deeply")
    lines = key_lines(text)
    profile, wrong = _understand(data, path)
    remarks: list[Remark] = [(ERROR, *problem) for problem in wrong]
    if profile is not None:
        already = {key for key, _, _ in wrong}
        more = [*_meant(profile, data), *(_published(profile) if publishing else ())]
        remarks += [remark for remark in more if remark[1] not in already]
    findings = [
        Finding(level, path.name, line_of(lines, key), key, what, fix)
        for level, key, what, fix in remarks
    ]
    section = data.get("pairs")
    names = section.get("keyword_files") if isinstance(section, dict) else None
    listed = names if isinstance(names, list) else []
    lists = tuple(name for name in listed if isinstance(name, str) and lies_beside(name, ".tsv"))
    return Checked(profile, lists, findings)


def _understand(data: dict[str, Any], path: Path) -> tuple[Profile | None, list[Problem]]:
    """The profile without its wrong keys, and what is wrong with them.

    Wrong keys hide others (a range is looked at when both ends are numbers), so it is read again
    without them, and without a section that lacks one, until nothing is left to say.
    """
    data = copy.deepcopy(data)
    wrong: dict[str, Problem] = {}
    if data.pop("path", None) is not None:
        wrong["path"] = ("path", "unknown key 'path'", "remove the line")
    while True:
        try:
            return Profile(**data, path=path.resolve()), list(wrong.values())
        except ValidationError as error:
            for problem in problems(error, Profile):
                wrong.setdefault(problem[0], problem)
            removed = [_removed(data, detail["loc"]) for detail in error.errors(include_url=False)]
            if not any(removed):
                return None, list(wrong.values())


def _removed(data: dict[str, Any], place: tuple[int | str, ...]) -> bool:
    """Take a wrong key, else the section around it, out of the data; False where neither is in."""
    keys = [part for part in place if isinstance(part, str)]
    while keys:
        *parents, last = keys
        table: Any = data
        for key in parents:
            table = table.get(key) if isinstance(table, dict) else None
        if isinstance(table, dict) and table.pop(last, None) is not None:
            return True
        keys = parents
    return False


# -- what the types allow and is probably not meant -----------------------------------------------


def _meant(profile: Profile, data: dict[str, Any]) -> Iterator[Remark]:
    """`data` is the file as read."""
    yield from _left_open("", data)
    yield from _own_name(profile)
    missing = [name for name in SOURCES if name not in data]
    for name in missing:
        fix = f"`kb {name} crawl` needs one; leave it out if you don't collect it"
        yield NOTE, "", f"there is no section [{name}]", fix
    if len(missing) == len(SOURCES):
        fix = f"add the section of at least one source: {', '.join(SOURCES)}"
        yield ERROR, "", "there is nothing to collect", fix
    (talks,) = made_of("pairs")
    if "pairs" not in data and talks in data:
        fix = "`kb pairs` needs one, with keyword_files or include"
        yield NOTE, "", "there is no section [pairs]", fix
    if "pairs" in data and talks in missing:
        fix = "pairs are made of the transcripts of videos"
        yield WARNING, "pairs", f"[pairs] has no use without [{talks}]", fix
    for name, recipe in own(profile).items():
        if not recipe.is_file():
            what = f"'{name}.pipeline' names {recipe.name}, which is not there"
            fix = "write the recipe next to the profile, or leave the line out"
            yield WARNING, f"{name}.pipeline", what, fix
    for name in SOURCES:
        if (section := getattr(profile, name)) is not None:
            yield from section.remarks()
    if profile.pairs:
        yield from repeated_remarks("pairs.include", profile.pairs.include)
        for word in filter(is_everyday, profile.pairs.include):
            fix = "put it into a keyword list, with the rule near, never or always"
            what = f"'pairs.include' contains the everyday word \"{word}\""
            yield WARNING, "pairs.include", what, fix
    if not profile.toxicity.on:
        fix = "the card of a release says so"
        yield NOTE, "toxicity", "'toxicity' is off: no text is scored", fix
    yield from _owner(profile)


def _owner(profile: Profile) -> Iterator[Remark]:
    """Licence, creator and contact of a release."""
    contact = profile.release.contact
    if contact and contact != FILL_IN and not is_contact(contact):
        what = f"'release.contact' is \"{contact}\", not an e-mail or web address"
        fix = "such as me@example.org or https://example.org/about"
        yield ERROR, "release.contact", what, fix
    if unlicensed := profile.release.unlicensed():
        fix = "an SPDX id for each, such as CC-BY-4.0; without, all but the release is made"
        yield NOTE, "", f"'release.licenses' names none of {', '.join(unlicensed)}", fix
    unsigned = profile.release.unsigned()
    if "a contact" in unsigned:
        fix = "where removal requests go; without, all but the release is made"
        yield NOTE, "", "'release.contact' is not set", fix
    if "a creator" in unsigned:
        fix = "who made the data set; without, all but the release is made"
        yield NOTE, "", "'release.creators' is not set", fix


def _published(profile: Profile) -> Iterator[Remark]:
    """What speaks against publishing alone, so that it ends no crawl."""
    contact = profile.release.contact
    if contact and contact != FILL_IN and is_placeholder(contact):
        fix = "write an address that you read, for removal requests"
        what = f"'release.contact' is the placeholder \"{contact}\""
        # A shipped one is the sandbox's; `kb release publish` refuses it all the same.
        yield NOTE if profile.is_shipped else ERROR, "release.contact", what, fix
    for source, spdx in profile.release.licenses.items():
        if spdx not in KNOWN:
            key = f"release.licenses.{source}"
            what = f"'{key}' is \"{spdx}\", not an SPDX id that a release can carry"
            yield ERROR, key, what, f"known: {', '.join(sorted(KNOWN))}"


def _left_open(key: str, value: Any) -> Iterator[Remark]:
    """Values that are still to be filled in and that no type refuses."""
    if isinstance(value, dict):
        for name, inner in value.items():
            yield from _left_open(f"{key}.{name}" if key else name, inner)
    elif value == FILL_IN or (isinstance(value, list) and FILL_IN in value):
        yield ERROR, key, f"'{key}' is still to be filled in", "write what is meant there"


def _own_name(profile: Profile) -> Iterator[Remark]:
    """A profile of another domain that has the name of a shipped one."""
    here, name = profile.path.parent, profile.name
    if here.parent == folder("profiles").resolve() and name != here.name:
        what = f"'name' is \"{name}\", and the profile's folder is {here.name}"
        yield ERROR, "name", what, f'a copied profile needs a name of its own: name = "{here.name}"'
        return
    for shipped in shipped_names():
        with contextlib.suppress(ProfileError):  # a damaged one has no name
            other = load_profile(shipped)
            if other.path == profile.path:
                continue
            subjects = list(_subjects(profile, other))
            differ = [key for key, mine, theirs in subjects if mine != theirs]
            if other.name == name and (differ or here.name != name):
                level = ERROR if len(differ) == len(subjects) else WARNING
                what = f"'name' is \"{name}\", that of the shipped profile"
                what += f"; other values: {', '.join(differ)}" if differ else ""
                fix = "another domain needs a name of its own; changed numbers alone may keep it"
                yield level, "name", what, fix
            elif other.name != name and other.title == profile.title:
                what = f"'title' is \"{profile.title}\", that of the profile {other.name}"
                yield WARNING, "title", what, "cards and reports bear it: write your domain's own"


def _subjects(profile: Profile, other: Profile) -> Iterator[tuple[str, Any, Any]]:
    """What a domain is about, where both profiles say it."""
    yield "title", profile.title, other.title
    for name in SOURCES:
        mine, theirs = getattr(profile, name), getattr(other, name)
        if mine is not None and theirs is not None and mine.subject:
            about = [getattr(section, mine.subject) for section in (mine, theirs)]
            own, other_own = (v.casefold() if isinstance(v, str) else v for v in about)
            yield f"{name}.{mine.subject}", own, other_own


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
        header = _HEADER.match(line)
        key = header or _KEY.match(line)
        if key is None:
            continue
        name = ".".join(part.strip("\"'") for part in re.findall(_PART, key[key.lastindex or 0]))
        if header is None:
            lines.setdefault(f"{table}.{name}" if table else name, number)
            continue
        table = name
        lines.setdefault(table, number)
        if header[1] == "[[":
            tables[table] += 1
            table = f"{table}[{tables[table]}]"
            lines.setdefault(table, number)
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
