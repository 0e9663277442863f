"""Whether a text can be a CSS selector, so that a slip is found before a crawl is spent.

The grammar of https://www.w3.org/TR/selectors-4/ down to the names of pseudo-classes and what
stands in their brackets: those the browser alone knows (kb.wiki.browser.selectors).
"""

from __future__ import annotations

import re

_NAME = r"(?:[\w-]|[^\x00-\x7f]|\\.)+"
_TEXT = r"\"(?:[^\"\\]|\\.)*\"|'(?:[^'\\]|\\.)*'"
_SIMPLE = re.compile(
    rf"\*|{_NAME}|[.#]{_NAME}"
    rf"|\[\s*{_NAME}(?:\s*[~|^$*]?=\s*(?:{_NAME}|{_TEXT})(?:\s*[iIsS])?)?\s*\]"
    rf"|::?{_NAME}(?P<open>\()?"
)
_COMBINATOR = re.compile(r"\s*[>+~,]\s*|\s+")
_INNER = re.compile(rf"{_TEXT}|[()]|[^()\"']+")


def problem(selector: str) -> str | None:
    """What is wrong with a list of selectors, None where nothing is."""
    text, place = selector.strip(), 0
    if not text:
        return "must be a CSS selector"
    wanted = True  # a simple selector must come
    while place < len(text):
        simple = _SIMPLE.match(text, place)
        if simple is None:
            between = None if wanted else _COMBINATOR.match(text, place)
            if between is None:
                return f"must be a CSS selector; {text[place:][:20]!r} is out of place"
            place, wanted = between.end(), True
            continue
        place, wanted = simple.end(), False
        if simple["open"]:
            end = _closed(text, place)
            if end is None:
                return f"must be a CSS selector; {simple[0]!r} is never closed"
            place = end
    return "must be a CSS selector; it ends before its last part" if wanted else None


def _closed(text: str, place: int) -> int | None:
    """The place behind the bracket that closes one opened before `place`."""
    depth = 1
    while (part := _INNER.match(text, place)) is not None:
        depth += (part[0] == "(") - (part[0] == ")")
        place = part.end()
        if not depth:
            return place
    return None
