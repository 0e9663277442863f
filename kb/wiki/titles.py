"""Files that name pages: titles one a line, a released Parquet file, or MineDojo's data.json."""

from __future__ import annotations

import json
import re
from collections.abc import Iterable
from pathlib import Path
from typing import NamedTuple
from urllib.parse import parse_qs, unquote, urlsplit

import pyarrow.parquet as pq

from kb.core.errors import SettingError
from kb.store import parquet

LONGEST = 1024  # bytes; MediaWiki's own titles end at 255, and a namespace before them
# One call asks for several titles with "|" between them, so it can stand in none. What else no
# title may hold ("[", "#" …) the wiki says itself: such a title is asked for, and is invalid.
_NO_TITLE = re.compile(r"[|\x00-\x1f\x7f]")


class Titles(NamedTuple):
    """`names` each once, in order; `ids` those that the file says are page ids.

    `bad_lines` can be no name.
    """

    names: list[str]
    ids: frozenset[str]
    bad_lines: int


def read_titles(path: Path) -> Titles:
    """The titles of `--titles FILE`. Raises SettingError (exit 2) also when there are none."""
    titles = read_names(path, "--titles", ("title",))
    if not titles.names:
        bad = f", only {titles.bad_lines} lines that can't be one" if titles.bad_lines else ""
        raise SettingError(f"--titles {path} holds no titles{bad}", hint="one title a line")
    return titles


def read_names(path: Path, option: str, columns: tuple[str, ...]) -> Titles:
    """Titles and addresses of pages by lines, Parquet or JSON, ids where `columns` has them.

    Of Parquet the first of `columns` that it has. A folder is that of a release: its pages.
    Underscores are spaces, as the wiki writes titles. Raises SettingError (exit 2).
    """
    try:
        entries = [entry for file in _files(path, option) for entry in _file(file, columns)]
    except OSError as error:
        raise SettingError(f"{option} {path} can't be read: {error.strerror or error}") from None
    except (ValueError, RecursionError) as error:
        raise SettingError(f"{option} {path} can't be read: {error}") from None
    names: dict[str, None] = {}
    ids, bad = set(), 0
    for entry in entries:
        name = str(entry).replace("_", " ").strip() if isinstance(entry, str | int) else ""
        if not name or _NO_TITLE.search(name) or len(name.encode("utf-8", "replace")) > LONGEST:
            bad += 1
            continue
        names[name] = None
        if isinstance(entry, int):
            ids.add(name)
    return Titles(list(names), frozenset(ids), bad)


def _files(path: Path, option: str) -> list[Path]:
    """The file itself, or the shards of a release's folder that name pages."""
    if not path.is_dir():
        return [path]
    if shards := sorted(path.glob("pages-*-of-*.parquet")):
        return shards
    raise SettingError(
        f"{option} {path} holds no released pages",
        hint=f"name the folder of a release, as in `{option} release/wiki`, or a file",
    )


def _file(path: Path, columns: tuple[str, ...]) -> Iterable[object]:
    with path.open("rb") as file:
        parquet = file.read(4) == b"PAR1"
    return _parquet(path, columns) if parquet else _text(path)


def _parquet(path: Path, columns: tuple[str, ...]) -> list[object]:
    there = pq.read_schema(path).names
    column = next((name for name in columns if name in there), None)
    if column is None:
        raise SettingError(
            f"{path} has no column {' or '.join(columns)}", hint="give a released wiki pages file"
        )
    return parquet.read_table(path, columns=[column])[column].to_pylist()


def _text(path: Path) -> Iterable[object]:
    """Lines, or JSON when the file is called so or begins with a bracket, as no title does."""
    text = path.read_text(encoding="utf-8-sig")
    if path.suffix == ".json" or text.lstrip()[:1] in ("[", "{"):
        data = json.loads(text)
        # One data.json of MineDojo's wiki, or a list of them, of titles, of addresses or of ids.
        return [_entry(entry) for entry in (data if isinstance(data, list) else [data])]
    lines = (line.strip() for line in text.split("\n"))
    return [_of_address(line) for line in lines if line and not line.startswith("#")]


def _entry(entry: object) -> object:
    """A title, or an id as a number; None for what names no page."""
    if isinstance(entry, dict):
        held = entry.get("metadata", entry)
        held = held if isinstance(held, dict) else {}
        entry = held.get("url") or held.get("title")
    if isinstance(entry, bool):
        return None
    return _of_address(entry) if isinstance(entry, str) else entry


def _of_address(name: str) -> str:
    """The title of an address, anything else as it is."""
    if not re.match(r"https?://", name):
        return name
    parts = urlsplit(name)
    if titles := parse_qs(parts.query).get("title"):
        return titles[0]
    return unquote(re.sub(r"^.*?/(?:wiki|w)/", "", parts.path).lstrip("/"))
