"""The slow, obvious way to find keywords: word by word in a trie of dicts.

What the fast one is held against.
"""

import unicodedata
from typing import NamedTuple

from kb.core import scripts


class Hit(NamedTuple):
    phrase: str
    start: int  # characters
    end: int


def joined(cues: list[dict]) -> str:
    """A transcript's text: its cues by start (what is no time counts as 0),
    one space between two.
    """

    def start(cue: dict) -> float:
        value = cue["start_s"]
        return round(max(value, 0) * 1000) if value is not None and abs(value) < 1e9 else 0

    return " ".join(cue["text"] or "" for cue in sorted(cues, key=start))


def words(text: str) -> list[tuple[str, int, int]]:
    """(folded word, start, end): runs of letters, digits and marks, and each sign of a script
    without spaces; invisible characters are looked through.
    """
    found: list[tuple[str, int, int]] = []
    word, start, end = "", 0, 0
    for place, char in enumerate(text):
        kind = unicodedata.category(char)
        if (kind == "Cf" and char != "\u200b") or "\ufe00" <= char <= "\ufe0f":
            continue
        if scripts.is_word(char):
            found += [(word, start, end)] if word else []
            found.append((char, place, place + 1))
            word = ""
        elif kind[0] in "LNM":
            if not word:
                start = place
            word, end = word + char.casefold(), place + 1
        elif word:
            found.append((word, start, end))
            word = ""
    return [*found, (word, start, end)] if word else found


def find(text: str, phrases: list[str]) -> list[Hit]:
    """Every phrase (folded words) in the text: the leftmost, of those the longest,
    then on behind it.
    """
    trie: dict = {}
    for phrase in phrases:
        node = trie
        for word in phrase.split(" "):
            node = node.setdefault(word, {})
        node[""] = phrase
    spoken, hits, at = words(text), [], 0
    while at < len(spoken):
        node, best, ahead = trie, None, at
        while ahead < len(spoken) and spoken[ahead][0] in node:
            node = node[spoken[ahead][0]]
            ahead += 1
            if "" in node:
                best = (node[""], ahead)
        if best is None:
            at += 1
        else:
            hits.append(Hit(best[0], spoken[at][1], spoken[best[1] - 1][2]))
            at = best[1]
    return hits
