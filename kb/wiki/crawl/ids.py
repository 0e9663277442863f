"""Reads lists of wiki pages: titles, URLs or page ids."""

import re
from collections.abc import Callable, Collection, Sequence
from functools import partial
from pathlib import Path
from urllib.parse import SplitResult, parse_qs, unquote, urlsplit

from kb.core.config.addresses import is_loopback
from kb.crawl.id_list import LEFT_OUT, IdList, IdRules, ListedId

LONGEST = 1024  # bytes; MediaWiki's own titles end at 255, and a namespace before them
# One call asks for several titles with "|" between them, so it can stand in none. What else no
# title may hold ("[", "#" …) the wiki says itself: such a title is asked for, and is invalid.
_NO_TITLE = re.compile(r"[|\x00-\x1f\x7f]")
_NO_NAME = re.compile(r"[\[\]{}<>#|\x00-\x1f\x7f]")
_LINK = re.compile(r"\[\[([^\[\]|#]+)(?:#[^\[\]|]*)?(?:\|[^\[\]]*)?\]\]")
# What stands before a title: the path of pages or scripts, or a variant of the language.
_BEFORE_TITLE = re.compile(
    r"^(?:/(?:wiki|w|mediawiki))?/index\.php(?=/|$)|^/(?:wiki|w)(?=/)|^/[a-z]{2,3}-[a-z]{2,8}(?=/)"
)
_BROWSER_TITLE = re.compile(r"\S (?:[-\u2013\u2014|:\u00b7]|::) \S")
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


def _rules(
    option: str,
    namespaces: Collection[int] | None,
    columns: tuple[str, ...],
    roots: Sequence[str] = (),
) -> IdRules:
    return IdRules(
        option=option,
        noun="titles",
        hint="write one title per line, or name a list of all titles from the wiki's dumps",
        columns=(*columns, "url", "page_title"),
        tables=(("pages",),),
        parse=partial(_title, namespaces, tuple(roots)),
        files="**/data.json",  # MineDojo's wiki_full
    )


def read_titles(
    path: Path,
    namespaces: Collection[int] = (),
    say: Callable[[str], None] | None = None,
    roots: Sequence[str] = (),
) -> IdList:
    """The titles of `--titles`; where a list says namespaces, those in `namespaces`, by default 0.
    With `roots`, addresses of the wiki, an address elsewhere is none.

    Raises SettingError (exit 2) also when there are none.
    """
    spaces = namespaces or (0,)
    rules = _rules("--titles", spaces, ("title",), roots)
    if roots and all(map(is_loopback, roots)):
        # A copy on loopback: a list of the original's addresses has none of its own.
        below = tuple(f"{root.rstrip('/')}/" for root in roots)
        if not any(str(entry.value).startswith(below) for entry in rules.entries(path)):
            rules = _rules("--titles", spaces, ("title",))
    return rules.some_ids_in(path, say)


def _title(
    namespaces: Collection[int] | None, roots: tuple[str, ...], entry: ListedId
) -> str | None:
    """A title as the wiki writes it, with spaces for underscores; None: all namespaces."""
    value, record = entry.value, entry.record
    if isinstance(value, bool) or not isinstance(value, (str, int)):
        return None
    text, space = str(value).strip(" \r\n"), record.get("ns", record.get("page_namespace"))
    bare = entry.column == "page_title"  # without the namespace's name
    if entry.column == "title" and isinstance(record.get("url"), str):
        text = _title_of_row(text, record["url"])
    if not entry.column and (numbered := _NUMBERED.fullmatch(text)):
        (space, text), bare = numbered.groups(), True
    number = int(space) if re.fullmatch(r"-?\d{1,9}", str(space)) else None
    if namespaces is not None and number is not None and number not in namespaces:
        return LEFT_OUT
    prefix = _NAMESPACES.get(number or 0) if bare else ""
    if prefix is None:
        return None
    title = _of_address(text, roots)
    if title is None:
        return None
    name = (prefix + title).replace("_", " ").strip()
    barred = _NO_NAME if namespaces is None else _NO_TITLE
    if not name or barred.search(name) or len(name.encode("utf-8", "replace")) > LONGEST:
        return None
    return name


def _title_of_row(text: str, url: str) -> str:
    """The title of a row with an address: as that has it where the text only adds to it, or is a
    browser's, with the wiki's name behind it ("Kiln – Valley Wiki"), which of a redirect begins
    with another page's title.
    """
    plain = (_of_address(url, ()) or "").replace("_", " ").strip()
    parts = urlsplit(url)
    named = _BEFORE_TITLE.match(parts.path) or "title=" in parts.query
    adds = text.casefold().startswith(plain.casefold()) or (named and _BROWSER_TITLE.search(text))
    return plain if plain and (not text or adds) else text


def _of_address(name: str, roots: tuple[str, ...]) -> str | None:
    """The title of an address or a link in wiki text, anything else as it is; None for an address
    that names no title, or one that is not below `roots`.
    """
    if link := _LINK.fullmatch(name):
        return link[1].lstrip(":")
    if not re.match(r"https?://", name):
        return name
    parts = urlsplit(name)
    path = parts.path
    for root in roots:
        at = urlsplit(root)
        if _host(at) == _host(parts) and path.startswith(at.path.rstrip("/") + "/"):
            path = path[len(at.path.rstrip("/")) :]
            break
    else:
        if roots:
            return None
    if titles := parse_qs(parts.query).get("title"):
        return titles[0]
    title = unquote(_BEFORE_TITLE.sub("", path, count=1).lstrip("/"))
    return None if not title or title.endswith(".php") else title


def _host(parts: SplitResult) -> str:
    """The host by which a wiki's desktop and mobile addresses are one."""
    return re.sub(r"^www\.|(^|(?<=\.))m\.", "", (parts.hostname or "").lower())


NAMES = _rules("--ids", None, ("page_id", "pageid", "title"))
"""Titles, addresses and page ids (`IdList.numbers`) of `--ids`."""
