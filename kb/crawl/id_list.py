"""Lists of ids as users have them, for `--ids` and `--titles`: one reader, with rules per source.

By content, not by name:

    Parquet     a column with ids
    JSON        a list of ids or of objects, several documents one after the other (NDJSON), or an
                object that holds such a list: an answer of MediaWiki's API (query.allpages) or of
                YouTube's (items), a playlist of yt-dlp (entries), pairs by keyword
                ({keyword: [[id, start, end]]}); or an object whose keys are ids
    CSV, TSV    a column with ids, with a header or without one
    lines       one id each; empty lines and those that begin with # are left out
    a folder    the shards of a release, or the files that the rules name

A column or key is found by its name, however that is written (`video_id`, `videoId`, `Video ID`),
or else by its values, where ids can't be mistaken for anything else. Text is decoded by its byte
order mark, else as UTF-8, and may be compressed with gzip. XML is refused: each of its lines would
be taken for an id.
"""

import csv
import json
import zlib
from codecs import BOM_UTF8
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import lru_cache
from itertools import chain, islice
from pathlib import Path
from typing import Any, NamedTuple

import msgspec
import pyarrow.parquet as pq

from kb.core.errors import SettingError
from kb.core.regular_file import open_regular, read_regular
from kb.crawl.file_text import cells, delimiter_of, documents, opened
from kb.schema.decode import in_batches
from kb.store.tables import parquet

_SHOWN = 20  # entries that are not ids
_HEAD = 4096  # characters by which a text's form is recognised
_SAMPLE = 1000  # rows by which a column is recognised
_PREAMBLE = 20  # lines that may stand before a header
_HOLDERS = ("metadata", "query", "allpages", "pages", "entries", "items", "data")
# Parts of a record of YouTube's API that name what the record is about.
_PARTS = ("id", "snippet", "contentDetails", "resourceId", "upload", "playlistItem")
# Names that mean something else in other lists: such a column counts if it holds ids.
_GENERIC = ("id", "key", "name", "url", "link")
LEFT_OUT = ""  # what `IdRules.parse` returns for an entry that is neither an id nor a mistake


class ListedId(NamedTuple):
    """One entry of a list as it stands there, in `record`, the row or object that holds it.

    `column` is "" for a line, and "[]" for a value of a JSON list.
    """

    value: Any
    column: str = ""
    record: Mapping[str, Any] = {}


class Column(NamedTuple):
    """A column or key of a list, and what the rules call it ("" where its values told it)."""

    name: Any
    known_as: str = ""


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
    columns   names of columns and keys that hold ids, best first: `video_id` is `Video ID` as well
    tables    tables of a release whose shards name ids together, the best of such groups first
    parse     entry → id, LEFT_OUT, or None for what is no id
    files     a pattern of files in a folder, each with the `metadata` of one thing
    is_unmistakable     whether a text can only be an id, so that a column is found by its values
    """

    option: str
    noun: str
    hint: str
    columns: tuple[str, ...]
    tables: tuple[tuple[str, ...], ...]
    parse: Callable[[ListedId], str | None]
    files: str = ""
    is_unmistakable: Callable[[str], bool] | None = None

    def ids_in(self, path: Path, say: Callable[[str], None] | None = None) -> IdList:
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
                    unread.append(_shown(entry))
            elif key != LEFT_OUT:
                keys[key] = None
                if isinstance(entry.value, int):
                    numbers.add(key)
        if bad and say is not None:
            lines = "1 bad line" if bad == 1 else f"{bad:,} bad lines"
            what = f"{lines} skipped (not {self.noun}); the first is {unread[0][:60]!r}"
            say(f"{self.option} {path}: {what}")
        return IdList(list(keys), frozenset(numbers), bad, tuple(unread))

    def some_ids_in(self, path: Path, say: Callable[[str], None] | None = None) -> IdList:
        """The same for a command that has nothing to do without one. Raises SettingError also when
        there is none.
        """
        listed = self.ids_in(path, say)
        if not listed.keys:
            first = _first_line(path) or "".join(listed.unread[:1])
            begins = f"; it begins with {first[:60]!r}" if first else ""
            what = f"{self.option} {path} contains no {self.noun}{begins}"
            raise SettingError(what, hint=self.hint)
        return listed

    def entries(self, path: Path) -> Iterator[ListedId]:
        """The entries of a list one by one.

        Raises SettingError when the list can't be read or is of another form.
        """
        with readable(path, self.option):
            for file in files_of(path, self):
                if is_parquet(file):
                    yield from _of_parquet(file, self)
                elif path.is_dir():
                    yield from _of_record(_metadata(file), self)
                else:
                    yield from _of_text(file, self)

    def known(self, names: Iterable[Any]) -> list[Column]:
        """Those of the names that are names of the rules, best first."""
        return _known(self.columns, tuple(names))

    def id_column(self, names: Iterable[Any], rows: Sequence[Mapping[Any, Any]]) -> Any:
        """The column of which most rows hold ids, some of them unmistakable; None if it is not half
        of them.
        """
        best, most = None, 0
        for name in dict.fromkeys(names) if self.is_unmistakable else ():
            values = [row[name] for row in rows if row.get(name) not in (None, "")]
            ids = self.ids_among(values)
            if 2 * ids >= len(values) and ids > most:
                best, most = name, ids
        return best

    def ids_among(self, values: Iterable[Any]) -> int:
        """How many values are ids; 0 if each of them could be a word."""
        texts = [text for text in values if isinstance(text, str)]
        if self.is_unmistakable is None or not any(map(self.is_unmistakable, texts)):
            return 0
        return sum(self.parse(ListedId(text)) is not None for text in texts)


@lru_cache(256)
def _known(columns: tuple[str, ...], names: tuple[Any, ...]) -> list[Column]:
    given = [(_fold(name), name) for name in names]
    return [Column(n, column) for column in columns for fold, n in given if fold == _fold(column)]


def _fold(name: Any) -> str:
    return "".join(filter(str.isalnum, str(name))).lower()


def _shown(entry: ListedId) -> str:
    """An entry as a message shows it."""
    if entry.value in (None, "") and entry.record:
        return json.dumps(entry.record, ensure_ascii=False, default=str)[:200]
    return str(entry.value)


def files_of(path: Path, rules: IdRules) -> list[Path]:
    """The file itself, or those in a folder that name ids. Raises SettingError for none."""
    if not path.is_dir():
        return [path]
    for group in rules.tables:
        patterns = [f"{name}-*-of-*.parquet" for name in group]
        every = [file for pattern in patterns for file in sorted(path.glob(pattern))]
        if shards := [file for file in every if file.is_file()]:  # nobody waits for a pipe
            return shards
    if rules.files:
        listed = sorted(path.glob(rules.files))
        visible = [
            file for file in listed if not any(p[:1] == "." for p in file.relative_to(path).parts)
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
    with open_regular(path) as file:
        return file.read(4) == b"PAR1"


def _first_line(path: Path) -> str:
    """Of a file of text the first line that is not empty."""
    if path.is_dir() or is_parquet(path):
        return ""
    with opened(path) as file:
        return next((line.strip() for line in file if line.strip()), "")


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
    return msgspec.json.decode(read_regular(path).removeprefix(BOM_UTF8), type=_Described).metadata


def _of_parquet(path: Path, rules: IdRules) -> Iterator[ListedId]:
    """By columns with a known name where there are some, else by all of them."""
    with parquet.open_file(path) as file:
        named = [column.name for column in rules.known(file.schema_arrow.names)]
        batches = file.iter_batches(columns=named or None)
        yield from _of_rows((row for batch in batches for row in batch.to_pylist()), rules)


def _of_rows(rows: Iterator[dict[Any, Any]], rules: IdRules) -> Iterator[ListedId]:
    """The entries of a table's rows, by names of columns, else by the column that holds ids."""
    sample = list(islice(rows, _SAMPLE))
    id_column = rules.id_column([name for row in sample for name in row], sample)
    for row in chain(sample, rows):
        yield _by_name(row, rules) or ListedId(row.get(id_column), "", row)


def _of_text(path: Path, rules: IdRules) -> Iterator[ListedId]:
    with opened(path) as file:
        start = file.read(_HEAD).lstrip()
        file.seek(0)
        if start[:1] == "<" and not start.startswith(("<http", "<//")):
            raise SettingError(f"{rules.option} {path} is XML or HTML, not a list", hint=rules.hint)
        if start[:1] in ("[", "{") or path.suffix == ".json":
            for several in in_batches(documents(file.read()), _SAMPLE):
                yield from _of_records(several, rules)
            return
        lines = (line for line in file if line.strip() and not line.startswith("#"))
        sample = list(islice(lines, _SAMPLE))
        yield from _of_lines(sample, chain(sample, lines), rules)


def _of_lines(sample: Sequence[str], lines: Iterator[str], rules: IdRules) -> Iterator[ListedId]:
    """The entries of lines, of which `sample` are the first."""
    for number, header in enumerate(sample[:_PREAMBLE]):
        delimiter = delimiter_of(header)
        names = [name.strip().lower() for name in next(cells([header], delimiter))]
        if (number == 0 or len(names) > 1) and rules.known(names):
            # A playlist of Google Takeout may begin with a table about the playlist.
            table = cells(islice(lines, number + 1, None), delimiter)
            yield from _of_rows((dict(zip(names, row, strict=False)) for row in table), rules)
            return
        if rules.parse(ListedId(header.strip("\r\n "))):
            break
    if place := _unnamed_column(sample, rules):
        delimiter, at = place
        for number, values in enumerate(cells(lines, delimiter)):
            entry = ListedId(values[at] if at < len(values) else None, "", {"line": values})
            if number or rules.parse(entry):  # the first may be a header
                yield entry
        return
    for line in lines:
        several = _several(line, rules)
        yield from map(ListedId, several or [line.strip("\r\n ")])


def _several(line: str, rules: IdRules) -> list[str]:
    """The ids of a line that holds nothing else than several of them."""
    cells = [cell.strip() for cell in line.split(delimiter_of(line) or None)]
    filled = [cell for cell in cells if cell]
    certain = rules.is_unmistakable
    return filled if certain and len(filled) > 1 and all(map(certain, filled)) else []


def _unnamed_column(sample: Sequence[str], rules: IdRules) -> tuple[str, int] | None:
    """The delimiter and the place of a column without a name that holds ids; None for lines."""
    delimiter = delimiter_of(sample[0]) if sample else ""
    if rules.is_unmistakable is None or not delimiter:
        return None
    if any(_several(line, rules) or rules.parse(ListedId(line.strip("\r\n "))) for line in sample):
        return None
    rows = [dict(enumerate(values)) for values in cells(sample, delimiter)]
    at = rules.id_column(sorted({at for row in rows for at in row}), rows)
    return None if at is None else (delimiter, at)


def _of_records(values: Sequence[Any], rules: IdRules) -> Iterator[ListedId]:
    """The entries of JSON values that stand in one list."""
    rows = [value for value in values[:_SAMPLE] if isinstance(value, dict)]
    id_column = rules.id_column([name for row in rows for name in row], rows)
    for value in values:
        yield from _of_record(value, rules, id_column)


def _of_record(value: Any, rules: IdRules, id_column: Any = None) -> Iterator[ListedId]:
    """The entries of a JSON value. `id_column` holds ids where no key has a known name."""
    if isinstance(value, list):
        yield from _of_records(value, rules)
        return
    if not isinstance(value, dict):
        yield ListedId(value, "[]")
        return
    if value and all(map(_is_clips, value.values())):  # pairs by keyword
        for clip in chain.from_iterable(value.values()):
            yield ListedId(clip[0], "[]")
        return
    holder = next((name for name in _HOLDERS if isinstance(value.get(name), (dict, list))), None)
    if holder is not None:
        yield from _of_record(value[holder], rules)
    elif (entry := _by_name(value, rules)) is not None:
        yield entry
    elif lists := [records for records in value.values() if _is_records(records)]:
        for records in lists:
            yield from _of_records(records, rules)
    elif named := [group for group in (value, *value.values()) if _are_ids(group, rules)]:
        yield from (
            ListedId(key, "[]") for group in named for key in group
        )  # {id: …}, {"ids": [id]}
    else:
        yield ListedId(value.get(id_column), "", value)


def _by_name(record: Mapping[str, Any], rules: IdRules) -> ListedId | None:
    """The entry of a record by the name of its key, which may stand in a part of the record as in
    answers of YouTube's API; None where no key with a known name has an id.
    """
    mistaken = None
    for column in rules.known(record):
        value = record[column.name]
        if value is None or isinstance(value, (dict, list)):
            continue
        entry = ListedId(value, column.known_as, record)
        if rules.parse(entry) is not None:
            return entry
        if column.known_as not in _GENERIC:
            mistaken = mistaken or entry
    parts = (record[name] for name in _PARTS if isinstance(record.get(name), dict))
    return next((by_name for part in parts if (by_name := _by_name(part, rules))), mistaken)


def _are_ids(value: Any, rules: IdRules) -> bool:
    if not isinstance(value, (dict, list)) or not value:
        return False
    return rules.ids_among(value) == len(value)


def _is_records(value: Any) -> bool:
    return (
        isinstance(value, list)
        and bool(value)
        and all(isinstance(record, dict) for record in value)
    )


def _is_clips(value: Any) -> bool:
    return isinstance(value, list) and all(isinstance(clip, list) and clip for clip in value)
