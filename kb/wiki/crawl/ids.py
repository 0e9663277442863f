"""Reads lists of wiki pages: titles, URLs or page ids."""

import re
from collections.abc import Callable, Collection
from functools import partial
from pathlib import Path
from urllib.parse import parse_qs, unquote, urlsplit

from kb.crawl.id_list import LEFT_OUT, IdList, IdRules, ListedId

LONGEST = 1024  # bytes; MediaWiki's own titles end at 255, and a namespace before them
# One call asks for several titles with "|" between them, so it can stand in none. What else no
# title may hold ("[", "#" …) the wiki says itself: such a title is asked for, and is invalid.
_NO_TITLE = re.compile(r"[|\x00-\x1f\x7f]")
_NO_NAME = re.compile(r"[\[\]{}<>#|\x00-\x1f\x7f]")
_NUMBERED = re.compile(r"(-?\d+)\t(.*)")  # a line of a dump's list of all titles
# What every MediaWiki calls its own namespaces, whatever its language
# (https://www.mediawiki.org/wiki/Manual:Namespace); lists of dumps leave the name out.
_NAMESPACES = {
    0: "",
    2: "User:",
    4: "Project:",
    6: "File:",
    8: "MediaWiki:",
    10: "Template:",
    12: "Help:",
    14: "Category:",
}


def _rules(option: str, namespaces: Collection[int] | None, columns: tuple[str, ...]) -> IdRules:
    return IdRules(
        option=option,
        noun="titles",
        hint="write one title per line, or name a list of all titles from the wiki's dumps",
        columns=(*columns, "url", "page_title"),
        tables=(("pages",),),
        parse=partial(_title, namespaces),
        files="**/data.json",  # MineDojo's wiki_full
    )


def read_titles(
    path: Path, namespaces: Collection[int] = (), say: Callable[[str], None] | None = None
) -> IdList:
    """The titles of `--titles`; where a list says namespaces, those in `namespaces`, by default 0.

    Raises SettingError (exit 2) also when there are none.
    """
    return _rules("--titles", namespaces or (0,), ("title",)).read_some(path, say)


def _title(namespaces: Collection[int] | None, entry: ListedId) -> str | None:
    """A title as the wiki writes it, with spaces for underscores; None: all namespaces."""
    value, record = entry.value, entry.record
    if isinstance(value, bool) or not isinstance(value, (str, int)):
        return None
    text, space = str(value).strip(" \r\n"), record.get("ns", record.get("page_namespace"))
    bare = entry.column == "page_title"  # without the namespace's name
    if entry.column == "title" and isinstance(record.get("url"), str):
        text = record["url"]  # MineDojo's titles have the wiki's name behind them
    if not entry.column and (numbered := _NUMBERED.fullmatch(text)):
        (space, text), bare = numbered.groups(), True
    number = int(space) if re.fullmatch(r"-?\d{1,9}", str(space)) else None
    if namespaces is not None and number is not None and number not in namespaces:
        return LEFT_OUT
    prefix = _NAMESPACES.get(number or 0) if bare else ""
    if prefix is None:
        return None
    name = (prefix + _of_address(text)).replace("_", " ").strip()
    barred = _NO_NAME if namespaces is None else _NO_TITLE
    if not name or barred.search(name) or len(name.encode("utf-8", "replace")) > LONGEST:
        return None
    return name


def _of_address(name: str) -> str:
    """The title of an address, anything else as it is."""
    if not re.match(r"https?://", name):
        return name
    parts = urlsplit(name)
    if titles := parse_qs(parts.query).get("title"):
        return titles[0]
    name = re.sub(r"^.*?/(?:wiki|w)/", "", parts.path)
    return unquote(re.sub(r"^(?:.*?/)?index\.php/", "", name).lstrip("/"))


NAMES = _rules("--ids", None, ("page_id", "pageid", "title"))
"""Titles, addresses and page ids (`IdList.numbers`) of `--ids`."""
