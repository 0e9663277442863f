"""A keyword list as it is written: rows with their lines, and what is wrong with the others.

A tab-separated file with the columns `keyword`, `kind`, `rule`, `forms`; lines that begin with #
are comments.
"""

from __future__ import annotations

import difflib
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import NamedTuple

from kb.core.errors import ProfileError
from kb.core.profile.base import FILL_IN
from kb.pairs.fold import phrase

COLUMNS = ("keyword", "kind", "rule", "forms")
RULES = ("near", "near:WORDS", "never", "always")
NEVER = -1
LONGEST = 64  # characters of a phrase, so that it always fits in a text


@dataclass(frozen=True)
class Keyword:
    """`reach`: words around it in which it needs an unmistakable keyword.

    None: it needs none; NEVER: it makes no pair. `more`: forms of its own. `rule`: as written;
    "always" does what an empty one does, and says that an everyday word is meant.
    """

    name: str
    kind: str
    reach: int | None = None
    more: tuple[str, ...] = ()
    rule: str = field(default="", compare=False)


class Row(NamedTuple):
    """A keyword and the line that it stands on, counted from 1."""

    line: int
    keyword: Keyword


class KeywordProblem(NamedTuple):
    """A line that can't be used; 0 where the whole file can't."""

    line: int
    what: str
    mend: str


def scan(path: Path, near_words: int) -> tuple[Sequence[Row], Sequence[KeywordProblem]]:
    """Every row of a file, and every problem. `near_words` is the reach of a plain `near`."""
    try:
        # -sig: an editor's mark at the beginning of the file is no part of the first column.
        text = path.read_text(encoding="utf-8-sig")
    except (OSError, UnicodeDecodeError) as error:
        why = error.strerror if isinstance(error, OSError) else "it is not UTF-8 text"
        return (), (KeywordProblem(0, f"the keyword list {path} can't be read: {why}", ""),)
    return _understood(text, near_words)


@lru_cache(maxsize=8)  # a command checks its lists, and then uses them
def _understood(text: str, near_words: int) -> tuple[tuple[Row, ...], tuple[KeywordProblem, ...]]:
    rows: list[Row] = []
    problems: list[KeywordProblem] = []
    header = False
    for number, line in enumerate(text.splitlines(), start=1):
        if not line.strip() or line.startswith("#"):
            continue
        cells = [cell.strip() for cell in line.split("\t")]
        if not header:
            if tuple(cells) != COLUMNS:
                # Without its columns no other line means anything.
                return (), (KeywordProblem(number, *_no_header(line)),)
            header = True
            continue
        found = _row(cells, near_words)
        if isinstance(found, Keyword):
            rows.append(Row(number, found))
        else:
            problems.append(KeywordProblem(number, *found))
    return tuple(rows), tuple(problems)


def read(path: Path, near_words: int) -> list[Keyword]:
    """One keyword file. Raises ProfileError that names the line."""
    rows, problems = scan(path, near_words)
    if problems:
        first = problems[0]
        where = f"{path}:{first.line}: " if first.line else ""
        raise ProfileError(f"{where}{first.what}", hint=first.mend)
    return [row.keyword for row in rows]


def _no_header(line: str) -> tuple[str, str]:
    what = f"the first line must read {', '.join(COLUMNS)}, separated by tabs"
    if sorted(line.replace(",", " ").split()) == sorted(COLUMNS):
        return what, "it has the right names: put tabs between them, in this order"
    return what, ""


def _row(cells: list[str], near_words: int) -> Keyword | tuple[str, str]:
    """The keyword of a line, or what is wrong with it and how to mend it."""
    needed = "a line has a keyword, a kind, perhaps a rule and forms, separated by tabs"
    if len(cells) < 2:
        return needed, "this one has no tab"
    if len(cells) > len(COLUMNS):
        return needed, f"this one has {len(cells)} columns; commas separate several forms"
    cells = cells + [""] * (len(COLUMNS) - len(cells))
    name, kind, rule, forms = cells
    if FILL_IN in cells:
        return "the line is still to be filled in", "write a keyword and its kind"
    if not name or not kind:
        return needed, f"the {'kind' if name else 'keyword'} of this one is empty"
    folded = phrase(name)
    if not folded or len(folded) > LONGEST:
        wrong = f"more than {LONGEST} letters" if folded else "no word"
        return f"the keyword {name!r} has {wrong}", "write what is said in a video"
    reach = _reach(rule, near_words)
    if isinstance(reach, str):
        return f"the rule is {rule!r}; known: {', '.join(RULES)}, or nothing", reach
    more = tuple(form.strip() for form in forms.split(",") if form.strip())
    return Keyword(name, kind, reach, more, rule)


def _reach(rule: str, near_words: int) -> int | str | None:
    """What a rule means, or how to mend it."""
    name, colon, number = rule.partition(":")
    if rule in ("", "always"):
        return None
    if rule == "never":
        return NEVER
    if name == "near" and not colon:
        return near_words
    if name == "near" and number.isascii() and number.isdigit() and int(number) > 0:
        return int(number)
    if name == "near":
        return "near: is followed by a number of words, such as near:30"
    close = difflib.get_close_matches(name.lower(), ("near", "never", "always"), n=1, cutoff=0.5)
    return f"did you mean {close[0]}?" if close else "forms stand in the fourth column"
