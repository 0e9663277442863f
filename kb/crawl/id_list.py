"""Lists of ids as users have them, for `--ids` and `--titles`: one reader, with rules per source.

By content, not by name:

    Parquet     the first of the rules' columns that it has
    JSON        a list of ids or of objects, several documents one after the other (NDJSON), or an
                object that holds such a list: an answer of MediaWiki's API (query.allpages), a
                playlist of yt-dlp (entries), pairs by keyword ({keyword: [[id, start, end]]})
    CSV, TSV    with a header that names one of the columns
    lines       one id each; empty lines and those that begin with # are left out
    a folder    the shards of a release, or the files that the rules name

Text may be compressed with gzip. XML is refused: each of its lines would be taken for an id.
"""

import csv
import gzip
import json
import zlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import chain
from pathlib import Path
from typing import IO, Any, NamedTuple

import msgspec
import pyarrow.parquet as pq

from kb.core.errors import SettingError
from kb.store.tables import parquet

_SHOWN = 20  # entries that are not ids
_HEAD = 4096  # characters by which a text's form is recognised
_HOLDERS = ("metadata", "query", "allpages", "pages", "entries", "items")
LEFT_OUT = ""  # what `IdRules.parse` returns for an entry that is neither an id nor a mistake


class ListedId(NamedTuple):
    """One entry of a list as it stands there, in `record`, the row or object that holds it.

    `column` is "" for a line, and "[]" for a value of a JSON list.
    """

    value: Any
    column: str = ""
    record: Mapping[str, Any] = {}


class IdList(NamedTuple):
    """`keys` each once, in order; `numbers` those that the list gives as numbers.

    `bad_lines` entries are not ids; `unread` are the first of them.
    """

    keys: list[str]
    numbers: frozenset[str] = frozenset()
    bad_lines: int = 0
    unread: tuple[str, ...] = ()


@dataclass(frozen=True)
class IdRules:
    """How ids of one source are read.

    option    the option that names the list, for messages
    noun      what its entries are, in the plural: "video ids"
    hint      how to write one
    columns   names of columns and fields that hold ids, in lower case, best first
    tables    tables of a release whose shards name ids together, the best of such groups first
    parse     entry → id, LEFT_OUT, or None for what is no id
    files     a pattern of files in a folder, each with the `metadata` of one thing
    """

    option: str
    noun: str
    hint: str
    columns: tuple[str, ...]
    tables: tuple[tuple[str, ...], ...]
    parse: Callable[[ListedId], str | None]
    files: str = ""

    def read(self, path: Path, say: Callable[[str], None] | None = None) -> IdList:
        """All ids of a list. `say` gets one line when some entries are not ids.

        Raises SettingError.
        """
        keys: dict[str, None] = {}
        numbers, bad, unread = set(), 0, list[str]()
        for entry in self.entries(path):
            key = self.parse(entry)
            if key is None:
                bad += 1
                if len(unread) < _SHOWN:
                    unread.append(str(entry.value))
            elif key != LEFT_OUT:
                keys[key] = None
                if isinstance(entry.value, int):
                    numbers.add(key)
        if bad and say is not None:
            lines = "1 bad line" if bad == 1 else f"{bad:,} bad lines"
            what = f"{lines} skipped (not {self.noun}); the first is {unread[0][:60]!r}"
            say(f"{self.option} {path}: {what}")
        return IdList(list(keys), frozenset(numbers), bad, tuple(unread))

    def read_some(self, path: Path, say: Callable[[str], None] | None = None) -> IdList:
        """The same for a command that has nothing to do without one. Raises SettingError also when
        there is none.
        """
        listed = self.read(path, say)
        if not listed.keys:
            bad = f"; bad lines: {listed.bad_lines:,}" if listed.bad_lines else ""
            raise SettingError(f"{self.option} {path} contains no {self.noun}{bad}", hint=self.hint)
        return listed

    def entries(self, path: Path, more: Sequence[str] = ()) -> Iterator[ListedId]:
        """The entries of a list one by one. `more` are columns of Parquet that records are to hold.

        Raises SettingError when the list can't be read or is of another form.
        """
        with readable(path, self.option):
            for file in files_of(path, self):
                if is_parquet(file):
                    yield from _of_parquet(file, self, more)
                elif path.is_dir():
                    yield from _of_record(_metadata(file), self)
                else:
                    yield from _of_text(file, self)


def files_of(path: Path, rules: IdRules) -> list[Path]:
    """The file itself, or those in a folder that name ids. Raises SettingError for none."""
    if not path.is_dir():
        return [path]
    for group in rules.tables:
        patterns = [f"{name}-*-of-*.parquet" for name in group]
        if shards := [file for pattern in patterns for file in sorted(path.glob(pattern))]:
            return shards
    if rules.files:
        listed = sorted(path.glob(rules.files))
        visible = [
            one for one in listed if not any(p[:1] == "." for p in one.relative_to(path).parts)
        ]
        if visible:
            return visible
    names = " or ".join(chain.from_iterable(rules.tables))
    raise SettingError(
        f"{rules.option} {path} contains no released {names}",
        hint=f"give {rules.option} FILE, or the folder of a release",
    )


def column_of(path: Path, option: str, columns: Sequence[str]) -> str:
    """The first of these columns that a Parquet file has. Raises SettingError."""
    names = pq.read_schema(path).names
    column = next((name for name in columns if name in names), None)
    if column is None:
        raise SettingError(
            f"{option} {path} has no column {' or '.join(columns)}; it has {', '.join(names)}"
        )
    return column


def is_parquet(path: Path) -> bool:
    """Whether a file is Parquet by its first bytes."""
    with path.open("rb") as file:
        return file.read(4) == b"PAR1"


@contextmanager
def readable(path: Path, option: str) -> Iterator[None]:
    """What goes wrong with a list is a wrong option. Raises SettingError."""
    try:
        yield
    except OSError as error:
        raise SettingError(f"{option} {path} can't be read: {error.strerror or error}") from None
    except (ValueError, RecursionError, EOFError, zlib.error, csv.Error) as error:
        why = str(error).splitlines()[0]
        raise SettingError(f"{option} {path} can't be read: {why}") from None


class _Described(msgspec.Struct):
    metadata: Any = None


def _metadata(path: Path) -> Any:
    """Of a large document what describes it."""
    return msgspec.json.decode(path.read_bytes(), type=_Described).metadata


def _of_parquet(path: Path, rules: IdRules, more: Sequence[str]) -> Iterator[ListedId]:
    column = column_of(path, rules.option, rules.columns)
    names = set(pq.read_schema(path).names)
    with parquet.open_file(path) as file:
        wanted = [column, *(name for name in more if name in names and name != column)]
        for batch in file.iter_batches(columns=wanted):
            for row in batch.to_pylist():
                yield ListedId(row[column], column, row)


def _of_text(path: Path, rules: IdRules) -> Iterator[ListedId]:
    with _opened(path) as file:
        start = file.read(_HEAD).lstrip()
        file.seek(0)
        if start[:1] == "<":
            raise SettingError(f"{rules.option} {path} is XML or HTML, not a list", hint=rules.hint)
        if start[:1] in ("[", "{") or path.suffix == ".json":
            for document in _documents(file.read()):
                yield from _of_record(document, rules)
            return
        lines = (line for line in file if line.strip() and not line.startswith("#"))
        header = next(lines, "")
        delimiter = next((sign for sign in "\t,;" if sign in header), ",")
        names = [name.strip().strip('"').lower() for name in header.split(delimiter)]
        column = next((name for name in rules.columns if name in names), None)
        if column is None:
            yield from (ListedId(line.strip("\r\n ")) for line in chain([header], lines) if line)
            return
        # Titles hold quotation marks; what is between tabs is not quoted.
        split = csv.reader(
            lines,
            delimiter=delimiter,
            quoting=csv.QUOTE_NONE if delimiter == "\t" else csv.QUOTE_MINIMAL,
        )
        for cells in split:
            row = dict(zip(names, cells, strict=False))
            yield ListedId(row.get(column), column, row)


def _opened(path: Path) -> IO[str]:
    with path.open("rb") as file:
        packed = file.read(2) == b"\x1f\x8b"
    if packed:
        return gzip.open(path, "rt", encoding="utf-8-sig", newline="")
    return path.open(encoding="utf-8-sig", newline="")


def _documents(text: str) -> Iterator[Any]:
    """JSON documents that stand one after the other."""
    decoder, place = json.JSONDecoder(), 0
    while place < len(text):
        if text[place].isspace():
            place += 1
            continue
        document, place = decoder.raw_decode(text, place)
        yield document


def _of_record(value: Any, rules: IdRules) -> Iterator[ListedId]:
    """The entries of a JSON value."""
    if isinstance(value, list):
        for one in value:
            yield from _of_record(one, rules)
        return
    if not isinstance(value, dict):
        yield ListedId(value, "[]")
        return
    if value and all(map(_is_clips, value.values())):  # pairs by keyword
        for clip in chain.from_iterable(value.values()):
            yield ListedId(clip[0], "[]")
        return
    holder = next((name for name in _HOLDERS if isinstance(value.get(name), (dict, list))), None)
    column = next((name for name in rules.columns if value.get(name) is not None), None)
    if holder is not None:
        yield from _of_record(value[holder], rules)
    elif column is not None:
        yield ListedId(value[column], column, value)
    else:
        yield ListedId(None)


def _is_clips(value: Any) -> bool:
    return isinstance(value, list) and all(isinstance(clip, list) and clip for clip in value)
