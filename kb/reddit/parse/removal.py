"""Whether a post or comment is gone, and of what moment a record of it is.

Reddit says in the record itself that something is gone. Archives add `_meta`: since November 2023
they visit each record twice, a day or two apart, and keep the text of the first visit, so that a
deletion in between stands nowhere else.

    retrieved_2nd_on        when the second visit was; the score is of that moment
    was_deleted_later       there at the first visit, gone at the second
    was_initially_deleted   gone at the first visit, there at the second
    removal_type            who removed it: its author, or others

A value of `_meta` that can't be read counts as absent. An archive that only names a type of
removal, and not at which visit, is taken to mean the second: a text is rather lost than kept
against its author's will.
"""

import re
from collections.abc import Mapping
from typing import Any, NamedTuple

from kb.reddit.parse.answer_tree import PURGED

LATEST = 253402300800  # seconds of Unix time: the year 10000
_BY_ITS_AUTHOR = frozenset({"deleted", "author", "deleted by user"})
# One pair of brackets around it all. What follows the verb is known, as people also write of
# removals in brackets; behind it may stand a reason, with links.
_PLACEHOLDER = re.compile(
    r"""\s* \[ \s* (?:(?: comment | post | submission | content ) \s+ )?
    (?P<verb> removed | deleted )
    (?: \s+ by \s+ (?:(?: the | a | an | its ) \s+)?
            (?P<actor> user | author
                     | reddit (?: ['’]s )?
                       (?: \s+ (?: admin s? | legal | safety | filter s? | team ))*
                     | (?:(?: subreddit | r/\w+ ) \s+ )? (?: auto)? mod(?: erator)? s?
                     | admin s? | (?: spam \s+ )? filter s? | anti.evil \s+ op(?: eration)? s )
            (?: \s+ (?: on \s+ account \s+ of | in \s+ response \s+ to | for | due \s+ to )
                \b (?: [^\[\]] | \[ [^\[\]]* \] )* )?
      | \s+ (?: in \s+ response \s+ to \b | on \s+ account \s+ of \b
            | too \s+ quickly \s+ to \s+ be \s+ archived )
            (?: [^\[\]] | \[ [^\[\]]* \] )*
    )? \s* [.]? \s* \] \s*""",
    re.VERBOSE | re.IGNORECASE,
)
# Markdown's link around a text in brackets of its own: [[removed]](address), or HTML's.
_LINK = re.compile(
    r"""\[ [\s*_~]* (\[ .* \]) [\s*_~]* \] \( [^()]* (?: \([^()]*\) [^()]* )* \)
    | <a \b [^<>]* > [\s*_~]* (.*?) [\s*_~]* </a>""",
    re.VERBOSE | re.IGNORECASE | re.DOTALL,
)
_LONGEST, _LONGEST_LINK = 300, 4_000  # characters
_INVISIBLE = re.compile("[\u200b-\u200d\u2060\ufeff\\\\]")  # and the backslash of Markdown
_NO_LETTERS = re.compile(r"[^a-z]+")
_WORDS = {"true": True, "1": True, "false": False, "0": False}


class Removal(NamedTuple):
    """`deleted` by its author, `removed` by others, or `purged` here, the value that says so, and
    whether the record says when (`dated`: the moment is that of `retrieved`).
    """

    reason: str
    value: str
    dated: bool = True


def removal(record: Mapping[str, Any]) -> Removal | None:
    """Why a post or comment is gone; None when it is there.

    What the archive found at its second visit counts more than the fields of the first: of what
    came back in between only the text is looked at.
    """
    if record.get("author") == PURGED:
        return Removal(PURGED.strip("[]"), PURGED, dated=False)
    meta = record.get("_meta")
    if not isinstance(meta, dict):
        return _dated(_of_record(record), record)
    later, before = flag(meta.get("was_deleted_later")), flag(meta.get("was_initially_deleted"))
    kind = meta.get("removal_type")
    kind = kind if isinstance(kind, str) and kind.strip() else None
    if later or (kind and later is None and not before):
        dated = _second_visit(record) is not None
        if kind is None:
            own = _of_record(record) or Removal("removed", "was_deleted_later")
            return own._replace(dated=dated)
        by_author = _NO_LETTERS.sub(" ", kind.casefold()).strip() in _BY_ITS_AUTHOR
        return Removal("deleted" if by_author else "removed", kind[:200], dated)
    return _dated(_of_text(record) if before else _of_record(record), record)


def _dated(own_word: Removal | None, record: Mapping[str, Any]) -> Removal | None:
    return own_word and own_word._replace(dated=retrieved(record) is not None)


def retrieved(record: Mapping[str, Any]) -> int | None:
    """When the archive read a record last, in seconds since 1970; None when it doesn't say."""
    return _second_visit(record) or _first_visit(record)


def flag(value: Any) -> bool | None:
    """Yes or no, also as 1 and 0 or as words; None for anything else."""
    return _WORDS.get(str(value).lower()) if isinstance(value, (int, str)) else None


def _first_visit(record: Mapping[str, Any]) -> int | None:
    for name in ("retrieved_utc", "retrieved_on"):
        if (at := _moment(record.get(name))) is not None:
            return at
    return None


def _second_visit(record: Mapping[str, Any]) -> int | None:
    """None as well where it would be before the first one."""
    meta = record.get("_meta")
    at = _moment(meta.get("retrieved_2nd_on")) if isinstance(meta, dict) else None
    return None if at is None or at < (_first_visit(record) or 0) else at


def _moment(value: Any) -> int | None:
    if isinstance(value, str) and value.isascii() and value.isdigit() and len(value) < 20:
        value = int(value)
    if isinstance(value, (int, float)) and not isinstance(value, bool) and 0 < value < LATEST:
        return int(value)
    return None


def _of_record(thing: Mapping[str, Any]) -> Removal | None:
    """What Reddit says in the fields of a record."""
    if category := thing.get("removed_by_category"):
        if category in ("deleted", "author") or _in_place_of(_text(thing)) == "deleted":
            return Removal("deleted", str(category).strip())
        return Removal("removed", str(category))
    if of_text := _of_text(thing):
        return of_text
    if thing.get("is_robot_indexable") is False:
        return Removal("removed", "is_robot_indexable is false")
    if thing.get("author") == "[deleted]" and _text(thing) is None:
        return Removal("deleted", "[deleted]")
    return None


def _of_text(thing: Mapping[str, Any]) -> Removal | None:
    """The site's words in place of a text or title."""
    for text in (_text(thing), thing.get("title")):
        if reason := _in_place_of(text):
            return Removal(reason, str(text).strip())
    return None


def _in_place_of(text: Any) -> str | None:
    """The reason where a text is the site's or an archive's own, in any spelling; None where
    people may have written it.
    """
    if not isinstance(text, str) or "[" not in text or len(text) > _LONGEST_LINK:
        return None
    words = _INVISIBLE.sub("", text).strip(" \n*_~")
    if link := _LINK.fullmatch(words):
        words = link[1] or link[2]
    match = _PLACEHOLDER.fullmatch(words) if len(words) <= _LONGEST else None
    if match is None:
        return None
    who = (match["actor"] or match["verb"]).casefold()
    return "deleted" if who in ("user", "author", "deleted") else "removed"


def _text(thing: Mapping[str, Any]) -> Any:
    return thing.get("selftext", thing.get("body"))
