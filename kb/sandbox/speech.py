"""Generates what people in the invented world say and write: a grammar over a domain's nouns.

The rules are in data/speech.toml, and each line of a rule has further rules and nouns in it. A
video, a post and a wiki page have a cast, a subject and what goes with it, which all their texts
name; so a title, a transcript and the comments speak of the same things. The same random numbers
give the same words.
"""

from __future__ import annotations

import random
import re
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import NamedTuple

import msgspec

from kb.core.installation import pc
from kb.youtube.topic import whole_words

# The head of "boat with chest" is "boat".
_HEAD = re.compile(r"\s+(?:with|of|and|in|on|for|from|to|&)\s+")
# An article goes by the sound: "a unicorn", "an hour".
_CONSONANT = re.compile(r"uni|use|usu|ute|eu|one|ou[ij]")
_VOWEL = re.compile(r"[aeiouéèêâáàîôöäü]|hour|honest|heir")
_WITHOUT_PLURAL = re.compile(r"(?:ing|tion|ness|ism|logy|ity)$")
# Forms by whether the noun is a plural.
_AGREEING = {
    "are": ("is", "are"),
    "were": ("was", "were"),
    "have": ("has", "have"),
    "s": ("s", ""),
    "they": ("it", "they"),
    "them": ("it", "them"),
}


@dataclass(frozen=True)
class Noun:
    """A keyword in a sentence. `title` is as the profile writes it; `number`: "one" (countable),
    "many" (a plural) or "mass" ("gravel", "baking").
    """

    title: str
    number: str = "one"

    @classmethod
    def from_title(cls, title: str, mass: Collection[str], singular: Collection[str]) -> Noun:
        """The noun of a name, by its head. `mass`: words without a plural; `singular`: words that
        only look like one.
        """
        word = (_HEAD.split(title.lower())[0].split() or [""])[-1]
        if word in mass or _WITHOUT_PLURAL.search(word):
            return cls(title, "mass")
        plural = word.endswith("s") and not word.endswith(("ss", "us")) and word not in singular
        return cls(title, "many" if plural else "one")

    @property
    def name(self) -> str:
        """The bare words: "iron sword". An article of its own is left out ("The Nether")."""
        return self.title.lower().removeprefix("the ")

    def form(self, form: str = "") -> str:
        """`title`, `name`, `a` ("an iron sword", "gravel"), `more` ("another iron sword"), a key of
        `_AGREEING`, or the noun phrase ("the iron sword", "gravel").
        """
        if form in _AGREEING:
            return _AGREEING[form][self.number == "many"]
        if form in ("title", "name"):
            return str(getattr(self, form))
        if form == "more":
            return f"{'another' if self.number == 'one' else 'more'} {self.name}"
        if form == "a" and self.number == "one":
            vowel = _VOWEL.match(self.name) and not _CONSONANT.match(self.name)
            return f"{'an' if vowel else 'a'} {self.name}"
        return self.name if form == "a" or self.number == "mass" else f"the {self.name}"


MUSIC = "[Music]"
_TRIES = 50
_BEGINNING = re.compile(r"(?:^|(?<=[.?!] ))[a-zà-ÿ]")
_SLOT = re.compile(r"\{(\w+)(?:\.(\w+))?\}")
_FILE = Path(__file__).with_name("data") / "speech.toml"


class Grammar(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """data/speech.toml. `foreign`: sentences by language."""

    nouns: tuple[str, ...]
    tags: tuple[str, ...]
    channels: tuple[str, ...]
    mass: str
    singular: str
    foreign: dict[str, tuple[str, ...]]
    rules: dict[str, tuple[str, ...]]


@cache
def grammar() -> Grammar:
    """The grammar of every domain."""
    return msgspec.toml.decode(_FILE.read_bytes(), type=Grammar)


@cache
def _lines(rule: str) -> list[list[str]]:
    """The lines of a rule in parts: text, name and form of a slot, text …"""
    return [[part or "" for part in _SLOT.split(line)] for line in grammar().rules[rule]]


class Cast(NamedTuple):
    """What a text is about, and what else it names."""

    subject: Noun
    others: tuple[Noun, ...]


class Sentence(NamedTuple):
    """Something said in a video. `seconds`: how long it takes; `planted`: what it is when it is no
    part of the talk itself (kb/sandbox/youtube/planted.py).
    """

    start: float
    seconds: float
    text: str
    planted: str = ""


class Speech:
    """The texts of one domain.

    `names`: what is spoken of, the most frequent first. `topic`: the domain's words, of which the
    first stands in titles, and none in the other texts. `language`: what tracks of the domain's
    own language say is English. `verbs`: of tasks; `things`: the verbs of things that titles
    name; `nouns`: verbs that may be nouns.
    """

    def __init__(
        self,
        names: Sequence[str],
        topic: Sequence[str],
        language: str = "en",
        verbs: Sequence[str] = (),
        things: Mapping[str, str] | None = None,
        nouns: Sequence[str] = (),
    ) -> None:
        given = grammar()
        self.things, self.task_nouns = dict(things or {}), tuple(nouns)
        self.verbs = tuple(verbs) or ("make",)
        mass, singular = set(given.mass.split()), set(given.singular.split())
        self.topics, self.topic = tuple(topic), topic[0]
        self.nouns = [Noun.from_title(name, mass, singular) for name in names]
        self._weights = [1 / (place + 4) ** 0.8 for place in range(len(names))]
        self._foreign = {
            code: sentences for code, sentences in given.foreign.items() if code != language
        }

    def cast(self, rng: random.Random, size: int = 6) -> Cast:
        """A subject and up to `size` - 1 other nouns, the frequent ones more often."""
        drawn = rng.choices(self.nouns, self._weights, k=3 * size)
        subject, *others = list(dict.fromkeys(drawn))[:size]
        return Cast(subject, tuple(others) or (subject,))

    def line(self, rule: str, rng: random.Random, cast: Cast) -> str:
        """One line by a rule, in which {y} and {z} stay the same two nouns."""
        first, second = rng.sample((*cast.others, cast.subject)[: max(2, len(cast.others))], 2)
        # Half of what is said in a video is about its subject.
        if rule in ("step", "say") and rng.random() < 0.5:
            first = cast.subject
        return self._filled(rule, rng, {"x": cast.subject, "y": first, "z": second})

    def _filled(self, rule: str, rng: random.Random, nouns: dict[str, Noun]) -> str:
        parts = list(rng.choice(_lines(rule)))
        for place in range(1, len(parts), 3):
            name, form = parts[place], parts[place + 1]
            parts[place + 1] = ""
            if name in nouns:
                parts[place] = nouns[name].form(form)
            elif name == "topic":
                parts[place] = self.topic
            elif name == "verb":
                parts[place] = rng.choice(self.verbs)
            elif name in ("n", "k"):
                parts[place] = str(rng.randint(2, 99 if name == "n" else 12))
            else:
                parts[place] = self._filled(name, rng, nouns)
        return "".join(parts)

    def free(self, rule: str, rng: random.Random, cast: Cast) -> str:
        """A line that doesn't name the topic, as the planted cases turn on that."""
        lines = (self.line(rule, rng, cast) for _ in range(_TRIES))
        return next(
            (line for line in lines if not names_topic(self.topics, line)), cast.subject.title
        )

    def title(self, rng: random.Random, cast: Cast, rule: str = "title") -> str:
        """A video's title with the topic in it; `idle_title`: with verbs of tasks, and no task."""
        return _title_case(self.line(rule, rng, cast))

    def task_title(self, rng: random.Random, cast: Cast) -> tuple[str, str]:
        """A title that says what is done, and what: (title, task in lower case)."""
        task = self.line("task", rng, cast)
        around = rng.choice(grammar().rules["task_title"])
        values = {"task": task, "topic": self.topic, "n": rng.randint(2, 99)}
        return _title_case(around.format_map(values)), task.lower()

    def thing_title(self, rng: random.Random, cast: Cast) -> tuple[str, str]:
        """The same of a title that names a thing and no verb."""
        what, verb = rng.choice(sorted(self.things.items()))
        around = rng.choice(grammar().rules["thing_title"])
        thing = f"{cast.subject.name} {what}"
        values = {"thing": thing, "topic": self.topic, "n": rng.randint(2, 99)}
        praise = next((word for word in ("easiest", "best") if word in around.lower().split()), "")
        return _title_case(around.format_map(values)), " ".join(f"{verb} {praise} {thing}".split())

    def noun_title(self, rng: random.Random, cast: Cast) -> str:
        """A title in which a verb is a noun, or a thing is not made."""
        thing = f"{cast.subject.name} {rng.choice(sorted(self.things))}"
        around = rng.choice(grammar().rules["noun_title"])
        values = {"thing": thing, "noun": rng.choice(self.task_nouns), "topic": self.topic}
        return _title_case(around.format_map(values | {"n": rng.randint(2, 99)}))

    def plain_title(self, rng: random.Random, cast: Cast) -> str:
        """A title that doesn't name the topic."""
        return _title_case(self.free("plain_title", rng, cast))

    def text(self, rule: str, rng: random.Random, cast: Cast, sentences: int = 1) -> str:
        """Different sentences by a rule, without the topic's name, a line each."""
        lines = (sentence_case(self.free(rule, rng, cast)) for _ in range(2 * sentences))
        return "\n".join(list(dict.fromkeys(lines))[:sentences])

    def talk(self, rng: random.Random, cast: Cast, seconds: float, language: str) -> list[Sentence]:
        """What is said in a video, from its first seconds to its last ones.

        At a speaker's own pace, with pauses; in a video of hours these are long.
        """
        sentences: list[Sentence] = []
        pace = rng.uniform(0.048, 0.062)  # seconds a letter
        pause = 0.6 * max(1.0, seconds / 2_400) ** 1.5
        clock = rng.uniform(0.1, 2.0)
        if language in self._foreign:
            closing = rng.choice(self._foreign[language])
        else:
            closing = self.line("closing", rng, cast)
        ends = seconds - 0.3 - pace * letters(closing)
        for text in self._sentences(rng, cast, language):
            length = pace * letters(text)
            if clock + length > ends:
                break
            sentences.append(Sentence(round(clock, 2), round(length, 2), text))
            clock += length + rng.uniform(0.3, 1.7) * pause
            if rng.random() < 0.02 and clock + 3 < ends:
                sentences.append(Sentence(round(clock, 2), 2.5, MUSIC))
                clock += 3
        if ends > 0.1:
            sentences.append(Sentence(round(ends, 2), round(pace * letters(closing), 2), closing))
        return sentences

    def _sentences(self, rng: random.Random, cast: Cast, language: str) -> Iterator[str]:
        """Without end: an opening, then steps, each with statements about it."""
        if language in self._foreign:
            while True:
                yield rng.choice(self._foreign[language])
        yield self.line("opening", rng, cast)
        yield self.line("plan", rng, cast)
        while True:
            yield self.line("step", rng, cast)
            for _ in range(rng.randint(2, 6)):
                yield self.line("say", rng, cast)


_pattern = cache(whole_words)


def names_topic(topic: Sequence[str], text: str) -> bool:
    """Whether the topic filter sees one of the topic's words in a text."""
    folded = text.casefold()  # most texts have none; the filter's own pattern takes milliseconds
    if not any(all(word in folded for word in phrase.casefold().split()) for phrase in topic):
        return False
    return bool(pc.match_substring_regex(text, _pattern(tuple(topic))).as_py())


def sentence_case(text: str) -> str:
    """With a capital at the beginning of each sentence."""
    return _BEGINNING.sub(lambda begin: begin[0].upper(), text)


def letters(text: str) -> int:
    """How long a text takes to say: its letters, and two for the end of each word."""
    return len(text) + text.count(" ") + 2


def _title_case(text: str) -> str:
    return " ".join(word[:1].upper() + word[1:] for word in text.split())
