"""The slow, obvious way to count who speaks of what: word by word, one text after the other."""

from collections.abc import Sequence
from typing import NamedTuple

from kb.pairs.keywords import EXCLUDED, NEVER, Keywords
from tests.pairs import reference

Row = tuple[str, str, str, str, str, int, "float | None"]


class Hit(NamedTuple):
    """A keyword's number, and the first and last word of where it stands."""

    keyword: int
    first: int
    last: int


def hits(blocks: Sequence[str], keywords: Keywords) -> list[Hit]:
    """Keywords that count in a text of blocks, which no phrase crosses; a block's end is a word."""
    owner = dict(zip(keywords.phrases, keywords.of, strict=True))
    found, before = [], 0
    for block in blocks:
        for phrase, start, end in reference.find(block, list(owner)):
            if owner[phrase] != EXCLUDED:
                first, last = (before + word_at(block, at) for at in (start, end - 1))
                found.append(Hit(owner[phrase], first, last))
        before += len(block.split()) + 1
    certain = [one for one in found if keywords.every[one.keyword].reach is None]
    return [one for one in found if _counts(one, certain, keywords)]


def word_at(text: str, place: int) -> int:
    """Which of a text's words, parted by white space, holds a character."""
    return len(text[: place + 1].split()) - 1


def _counts(one: Hit, certain: list[Hit], keywords: Keywords) -> bool:
    reach = keywords.every[one.keyword].reach
    if reach is None:
        return True
    if reach == NEVER:
        return False
    return any(
        0 < one.first - other.last <= reach or 0 < other.first - one.last <= reach
        for other in certain
    )


def mentions(
    source: str, key: str, part: str, blocks: Sequence[str | None], keywords: Keywords
) -> list[Row]:
    """Rows of a text that is not timed."""
    count: dict[str, int] = {}
    for one in hits([block or "" for block in blocks], keywords):
        name = keywords.every[one.keyword].name
        count[name] = count.get(name, 0) + 1
    return [(name, source, key, part, "mention", n, None) for name, n in count.items()]


def transcript(key: str, cues: Sequence[tuple[int, str]], keywords: Keywords) -> list[Row]:
    """Rows of a transcript whose cues (second, text) last until the next, the last one second: each
    word gets an even share of its cue.
    """
    times: list[float] = []
    for at, (start, text) in enumerate(cues):
        end = cues[at + 1][0] if at + 1 < len(cues) else start + 1
        words = len(text.split())
        times += [
            (start * 1000 + (end - start) * 1000 * place // words) / 1000 for place in range(words)
        ]
    seen: dict[str, tuple[int, float]] = {}
    for one in hits([" ".join(text for _, text in cues)], keywords):
        name = keywords.every[one.keyword].name
        count, first = seen.get(name, (0, float("inf")))
        seen[name] = count + 1, min(first, times[one.first])
    return [
        (name, "youtube", key, "transcript", "mention", count, first)
        for name, (count, first) in seen.items()
    ]
