"""Words of an invented world, made from a profile's keywords where it has no `world.toml`.

Sentences are of no domain; what they speak of are the profile's own keywords. Titles and
descriptions take only keywords without a topic word in them, as the planted cases turn on whether
the topic is named.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from functools import cache
from pathlib import Path

import msgspec
import pyarrow as pa
import pyarrow.compute as pc

from kb.core import clock
from kb.core.profile import Profile
from kb.filters.topic import whole_words
from kb.pairs.listed import NEVER, Keyword
from kb.sandbox.speech import Sayings, Words

_CERTAIN, _EVERYDAY = 45, 15  # most keywords of each kind that are spoken of
_PHRASES = Path(__file__).with_name("data") / "phrases.toml"


class Phrases(Sayings, frozen=True):
    """What is said whatever the domain (data/phrases.toml)."""

    plain: tuple[str, ...]
    tags: tuple[str, ...]


@cache
def _phrases() -> Phrases:
    return msgspec.toml.decode(_PHRASES.read_bytes(), type=Phrases)


def words_of(profile: Profile, listed: Sequence[Keyword]) -> Words:
    """The lists of a profile, with its `listed` keywords in them."""
    said, section = _phrases(), profile.youtube
    topic = section.words if section else (profile.title,)
    searches = section.keywords if section else (profile.title,)
    things = _spoken(listed) or said.plain
    plain = tuple(_without(topic, [_for_text(one) for one in things])) or _free(topic, said.plain)
    free = _free(topic, said.tags)
    return Words(
        tags=(topic[0].lower(), free[0], free[1]),
        poll=_free(topic, said.poll)[:2],
        slots=("thing", "thing2", "plain", "plain2"),
        link_words="plain",
        channels=tuple(
            name.format(_for_text(plain[n % len(plain)]).title())
            for n, name in enumerate(said.channels)
        ),
        channel_kinds=_kinds(searches, len(said.channels)),
        sayings=said.sayings,
        endings=said.endings,
        titles=said.titles,
        plain_titles=_free(topic, said.plain_titles),
        about=_free(topic, said.about),
        posts=said.posts,
        words={"thing": things, "plain": plain},
        foreign={
            language: lines
            for language, lines in said.foreign.items()
            if language != (section.language if section else "en")
        },
    )


def names(profile: Profile, listed: Iterable[Keyword]) -> tuple[str, ...]:
    """Keywords that can be titles of wiki pages, first letter large, each once."""
    fit = (one.name for one in listed if re.fullmatch(r"\w[\w '(),.!&-]*", one.name))
    titles = dict.fromkeys(name[:1].upper() + name[1:] for name in fit)
    return tuple(name for name in titles if name not in ("Main Page", profile.title))


def first_class(selector: str) -> str:
    """The first class that a CSS selector names, if it does."""
    match = re.search(r"\.([A-Za-z_][\w-]*)", selector)
    return match[1] if match else ""


def _spoken(listed: Sequence[Keyword]) -> tuple[str, ...]:
    """As many keywords as are spoken of, everyday words among them."""
    rng = clock.rng("words of the invented world")
    certain = [one.name for one in listed if one.reach is None]
    others = [one.name for one in listed if one.reach not in (None, NEVER)]
    some = [
        *rng.sample(certain, min(len(certain), _CERTAIN)),
        *rng.sample(others, min(len(others), _EVERYDAY)),
    ]
    return tuple(_for_text(one).lower() for one in some)


def _for_text(name: str) -> str:
    """A keyword in a sentence, whose braces would be read as a slot."""
    return name.replace("{", "").replace("}", "")


def _without(topic: Sequence[str], texts: Sequence[str]) -> list[str]:
    """The texts that don't name the topic, as the filter reads them."""
    hits = pc.match_substring_regex(pa.array(texts, pa.string()), whole_words(topic))
    return [text for text, hit in zip(texts, hits.to_pylist(), strict=True) if not hit]


def _free(topic: Sequence[str], texts: Sequence[str]) -> tuple[str, ...]:
    """The same of sentences of ours; all of them where every one names the topic."""
    allowed = _without(topic, [re.sub(r"\{\w+\}", "x", text) for text in texts])
    kept = tuple(text for text in texts if re.sub(r"\{\w+\}", "x", text) in allowed)
    return kept if len(kept) > 1 else tuple(texts)


def _kinds(searches: Sequence[str], channels: int) -> tuple[str, ...]:
    """What each channel says that it is about: every search finds some."""
    if len(searches) <= channels:
        return tuple(searches)
    return tuple(" ".join(searches[n::channels]) for n in range(channels))
