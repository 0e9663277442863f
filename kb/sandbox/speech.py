"""What people in the invented world say and write: sentences put together from word lists.

The lists are a profile's own (`world.toml` beside it), or made from its keywords
(kb/sandbox/made_words.py).
"""

from __future__ import annotations

import random
import re

import msgspec


class Sayings(msgspec.Struct, frozen=True):
    """What people say, as sentences and templates. `foreign`: sentences by language."""

    poll: tuple[str, ...]
    channels: tuple[str, ...]
    sayings: tuple[str, ...]
    endings: tuple[str, ...]
    titles: tuple[str, ...]
    plain_titles: tuple[str, ...]
    about: tuple[str, ...]
    posts: tuple[str, ...]
    foreign: dict[str, tuple[str, ...]]


class Words(Sayings, frozen=True, forbid_unknown_fields=True):
    """The lists of a domain.

    Sentences are templates: {topic}, {n} and one name for each of `slots`. A slot takes a word of
    the list in `words` with its name, a number behind it aside.
    """

    tags: tuple[str, str, str]  # the first one names the topic, the others don't
    slots: tuple[str, ...]
    link_words: str
    channel_kinds: tuple[str, ...]
    words: dict[str, tuple[str, ...]]
    rtl_name: str = "مرحبا"
    other_label: str = "Something Else"
    recorded_wiki: bool = False


class Speech:
    """Titles, descriptions and talk of one domain."""

    def __init__(self, words: Words, topic: str) -> None:
        self.words, self.topic = words, topic
        self._slots = [(slot, words.words[re.sub(r"\d+$", "", slot)]) for slot in words.slots]

    def fill(self, template: str, rng: random.Random, topic: str = "") -> str:
        """A template with words chosen by `rng`."""
        number = rng.randint(2, 99)
        chosen = {slot: rng.choice(held) for slot, held in self._slots}
        return template.format(topic=topic, n=number, **chosen)

    def title(self, rng: random.Random) -> str:
        """A video's title with the topic in it."""
        return _cased(self.fill(rng.choice(self.words.titles), rng, self.topic))

    def plain_title(self, rng: random.Random) -> str:
        """A title that doesn't name the topic."""
        return _cased(self.fill(rng.choice(self.words.plain_titles), rng))

    def about(self, rng: random.Random, sentences: int = 3) -> str:
        """A description without the topic's name."""
        return "\n".join(self.fill(rng.choice(self.words.about), rng) for _ in range(sentences))

    def post(self, rng: random.Random) -> str:
        """A post's title."""
        return self.fill(rng.choice(self.words.posts), rng)

    def link_word(self, rng: random.Random) -> str:
        """A word for an address."""
        return "-".join(re.findall(r"\w+", rng.choice(self.words.words[self.words.link_words])))

    def sentence(self, rng: random.Random, language: str) -> str:
        """Something said in a video."""
        if language in self.words.foreign:
            return rng.choice(self.words.foreign[language])
        said = self.fill(rng.choice(self.words.sayings), rng)
        return f"{said} {rng.choice(self.words.endings)}" if rng.random() < 0.3 else said

    def cues(
        self, rng: random.Random, language: str, seconds: float, *, rolling: bool
    ) -> list[tuple[float, float, str]]:
        """(start s, duration s, text) of a caption track.

        `rolling`: as automatic captions are, five to seven words a cue, each shown until the next
        but one begins; otherwise whole sentences one after the other.
        """
        made: list[tuple[float, float, str]] = []
        clock, end = round(rng.uniform(0.1, 2.0), 2), min(seconds, 120.0)
        while clock < end - 3:
            if rng.random() < 0.04:
                made.append((clock, 2.5, "[Music]"))
                clock = round(clock + 2.5, 2)
                continue
            words = self.sentence(rng, language).split()
            size = rng.randint(5, 7) if rolling else len(words)
            for at in range(0, len(words), size):
                piece = words[at : at + size]
                length = round(0.4 + 0.38 * len(piece), 2)
                made.append((clock, round(length * (1.9 if rolling else 1.0), 2), " ".join(piece)))
                clock = round(clock + length, 2)
            clock = round(clock + rng.uniform(0.0, 0.8), 2)
        return made


def _cased(text: str) -> str:
    return " ".join(word[:1].upper() + word[1:] for word in text.split())
