"""People who ask to be left out: who a list names, and what of theirs is in a data root.

Whoever asks gives a name. It is in memory for the run and in nothing that is written or said: a
*mark* stands for the person, which is made of the name and has the form of a part of a key. The
tombstone of a person is made of it, and keeps away what they publish later.
"""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import pyarrow as pa
import pyarrow.compute as pc

from kb.artifacts.purge_named import KNOWN, NAMED, UNKNOWN
from kb.artifacts.purge_rows import RowLocation
from kb.core.errors import DamagedData, SettingError
from kb.core.regular_file import read_regular
from kb.store.state import tombstones
from kb.store.state.tombstones import PERSON
from kb.store.tables import parquet
from kb.store.tables.reading import reading

Purge = Any  # kb.artifacts.purge.Purge, whose module imports this one
MARK = "mark"  # kind of name: what stands for people
_SHOWN = 10  # numbers of lines without a name
_BATCH = 65_536


class PeopleList(NamedTuple):
    """Names of people, and the numbers of the lines that name nobody."""

    names: tuple[str, ...]
    unread: tuple[int, ...] = ()


class Theirs(NamedTuple):
    """Something of a person in a data root: by `mark` whose it is, and its key.

    With `of` it is another name, of that kind (see kb.artifacts.purge_raw.Names).
    """

    mark: str
    name: str
    of: str = ""


@dataclass(frozen=True)
class PeopleRules:
    """How people of one source are named and found.

    option    the option that names the list, for messages
    noun      who they are, in the plural: "authors"
    hint      how to name one
    parse     a line → a name, the same for all ways to write it; None for what names nobody
    marks     what stands for a named person, and then what did in older data roots
    find      what is in the data root of the people with some of these marks
    """

    option: str
    noun: str
    hint: str
    parse: Callable[[str], str | None]
    marks: Callable[[Purge, str], tuple[str, ...]]
    find: Callable[[Purge, frozenset[str]], Iterable[Theirs]]

    def read_people(self, path: Path) -> PeopleList:
        """The people that a file names, one a line; empty lines and those with # are comments.

        Raises SettingError where it names nobody. No message has a word of the file, or its name.
        """
        try:
            data = read_regular(path)
        except OSError as error:
            why = error.strerror or type(error).__name__
            raise SettingError(f"{self.option}: the file can't be read: {why}") from None
        is_utf_16 = data.startswith((b"\xff\xfe", b"\xfe\xff"))
        text = data.decode("utf-16" if is_utf_16 else "utf-8-sig", "replace")
        names, unread = dict[str, None](), []
        for number, line in enumerate(re.split(r"\r\n|\r|\n", text), 1):
            entry = re.split(r"(?:^|\s)#", line, maxsplit=1)[0].strip(" \t\"'<>,;\0")
            if not entry:
                continue
            if name := self.parse(entry):
                names[name] = None
            else:
                unread.append(number)
        if not names:
            what = f"names none of the {self.noun}" if not unread else self.unread(unread)
            raise SettingError(f"{self.option}: {what}", hint=self.hint)
        return PeopleList(tuple(names), tuple(unread))

    def unread(self, lines: Iterable[int]) -> str:
        """Which lines name nobody."""
        listed = list(lines)
        shown = ", ".join(f"{number:,}" for number in listed[:_SHOWN])
        more = f" and {len(listed) - _SHOWN:,} more" if len(listed) > _SHOWN else ""
        return f"unread, as it names nobody: line {shown}{more}"


def people(purge: Purge, rules: PeopleRules, listed: PeopleList | None) -> dict[str, str]:
    """The keys of what is in the data root of the people that are listed or were before, with
    NAMED; and those that stand for the listed people, with NAMED, KNOWN or UNKNOWN.

    Also sets `purge.other_names`.
    """
    before = tombstones.people(purge.root, purge.rules.source)
    asked = defaultdict[str, set[str]](set)
    for name in listed.names if listed else ():
        first, *older = rules.marks(purge, name)
        asked[first].update((first, *older))
    left = (key.removeprefix(PERSON) for key in purge.keys if key.startswith(PERSON))
    marks = before.union(left, *asked.values())
    theirs: dict[str, str] = {}
    seen = set()
    others = defaultdict[str, set[str]](set)
    others[MARK] |= marks
    for item in rules.find(purge, marks) if marks else ():
        seen.add(item.mark)
        if item.of:
            others[item.of].add(item.name)
        else:
            theirs[item.name] = NAMED
    purge.other_names = dict(others)
    for first, all_of_them in asked.items():
        here = seen & all_of_them
        theirs[PERSON + first] = NAMED if here else KNOWN if first in before else UNKNOWN
        theirs |= {PERSON + mark: NAMED for mark in here}
    return theirs


def say_absent(
    rules: PeopleRules, listed: PeopleList, people: Mapping[str, str], say: Callable[[str], None]
) -> None:
    """Say which lines name nobody, and of how many people the data root never had anything."""
    if listed.unread:
        say(f"{rules.option}: {rules.unread(listed.unread)}; {rules.hint}")
    if unknown := sum(why == UNKNOWN for why in people.values()):
        who = f"{unknown:,} of the {rules.noun}"
        say(f"{rules.option}: nothing of {who} was ever in this data root; it stays that way")


def in_rows(
    root: Path,
    location: RowLocation,
    column: str,
    marks: frozenset[str],
    mark: Callable[[str], str] = str,
) -> Iterator[Theirs]:
    """What the rows of a table show of people, whose `mark` is made of the value of a column.

    Nobody knows what a damaged file shows.
    """
    for path in location.files(root):
        with suppress(DamagedData), reading([path]), parquet.open_file(path) as file:
            for batch in file.iter_batches(_BATCH, columns=[location.column, column]):
                values = batch.column(column).cast(pa.string())
                by_value = {
                    value: mark(value)
                    for value in pc.unique(values).drop_null().to_pylist()
                    if mark(value) in marks
                }
                hit = pc.is_in(values, value_set=pa.array(by_value, pa.string()))
                keys = batch.column(location.column).cast(pa.string()).filter(hit)
                for key, value in zip(
                    keys.to_pylist(), values.filter(hit).to_pylist(), strict=True
                ):
                    yield Theirs(by_value[value], f"{location.prefix}{key}")
