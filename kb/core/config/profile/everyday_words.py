"""Words that everybody says, whatever the subject: alone they tell no domain."""

from functools import cache
from pathlib import Path


def is_everyday(text: str) -> bool:
    """Whether it is a single word of the list beside this file, or its plural, in any case."""
    word = text.strip().casefold()
    return any(form in _words() for form in (word, word.removesuffix("s"), word.removesuffix("es")))


@cache
def _words() -> frozenset[str]:
    text = Path(__file__).with_name("everyday_words.txt").read_text(encoding="utf-8")
    lines = (line for line in text.splitlines() if not line.startswith("#"))
    return frozenset(" ".join(lines).split())
