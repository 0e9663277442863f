"""Words of an invented world, made from a profile's keywords where it has no `world.toml`.

Sentences are of no domain; what they speak of are the profile's own keywords. Titles and
descriptions take only keywords without a topic word in them, as the planted cases turn on whether
the topic is named.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence

import pyarrow as pa
import pyarrow.compute as pc

from kb.core import clock
from kb.core.profile import Profile
from kb.filters.topic import whole_words
from kb.pairs.listed import NEVER, Keyword
from kb.sandbox.speech import Words

_CERTAIN, _EVERYDAY = 45, 15  # most keywords of each kind that are spoken of
_PLAIN = ("first step", "second try", "last part", "small detail", "whole list", "short way")
_TAGS = ("how it works", "step by step", "in one evening", "a closer look", "for everyone")
_POLL = ("the first one", "this & that", "neither", "both of them")
_CHANNELS = (
    "{} Corner",
    "{} & Co",
    "The Long {}",
    "Quiet {}",
    "{} Notes",
    "{} Weekly",
    "{} and More",
    "Tuesday {}",
    "{} Diary",
    "Second {}",
    "{} Hour",
    "{} Radio",
)
_SAYINGS = (
    "today we look at the {thing} and what it is for",
    "first you need the {thing} before anything else",
    "look at the {thing} next to the {thing2}",
    "put the {thing} beside the {thing2}",
    "never start with the {thing} when the {thing2} is not ready",
    "let us go back to the {thing} once more",
    "this is where the {thing} comes in",
    "most people forget about the {thing}",
    "i keep the {thing} close to the {thing2}",
    "you can see how the {thing} changes the {thing2}",
    "there is more to say about the {thing}",
    "and now for the {thing}",
    "that is how it works with the {thing}",
    "careful with the {thing} here",
    "the {thing} & the {thing2} don't always agree",
    "i'm going to show the {thing} again",
    "so much for the {thing2}",
    "okay that works",
)
_ENDINGS = (
    "so we have to be careful",
    "and that is easier than it looks",
    "which took me all night",
    "and it still surprises me",
    "but there is a better way",
    "so let us do it again",
    "and that is really all there is to it",
)
_TITLES = (
    "{topic}: The {plain}, Episode {n}",
    "{n} Things About the {plain} in {topic}",
    "{topic} From the Beginning: {plain}",
    "I Spent {n} Days With the {plain} - {topic}",
    "{topic} Part {n}: {plain} Trouble",
    "{topic} for Everyone: Your First {plain}",
    "The {plain} Is Finished! {topic} {n}",
)
_PLAIN_TITLES = (
    "The {plain}, Episode {n}",
    "The {plain} and the {plain2} (#{n})",
    "{n} Things About the {plain}",
    "My {plain}, Part {n}",
)
_ABOUT = (
    "In this episode we look at the {plain}.",
    "Watch out for the {plain} and the {plain2}.",
    "All you need is the {plain}, and some time.",
    "Recorded in one evening.",
    "This is number {n}.",
    "Thank you for watching.",
    "Next time: the {plain}.",
)
_POSTS = (
    "My {plain} after {n} days",
    "What do you do with the {plain}?",
    "Found this {plain} beside the {plain2}",
    "Is the {plain} worth it?",
)
_FOREIGN = {
    "en": (
        "today i show you something new",
        "first of all we need some patience",
        "be careful with the next step",
        "the rest comes last",
    ),
    "de": (
        "heute zeige ich euch etwas Neues",
        "zuerst brauchen wir etwas Geduld",
        "passt auf beim nächsten Schritt",
        "der Rest kommt als Letztes",
    ),
    "es": (
        "hoy os enseño algo nuevo",
        "primero necesitamos un poco de paciencia",
        "cuidado con el siguiente paso",
        "el resto va al final",
    ),
    "ja": (
        "今日は新しいことを紹介します",
        "まず少し待ちましょう",
        "次は気をつけて",
        "最後に残りです",
    ),
}


def words_of(profile: Profile, listed: Sequence[Keyword]) -> Words:
    """The lists of a profile, with its `listed` keywords in them."""
    section = profile.youtube
    topic = section.words if section else (profile.title,)
    searches = section.keywords if section else (profile.title,)
    things = _spoken(listed) or _PLAIN
    plain = tuple(_without(topic, [_for_text(one) for one in things])) or _free(topic, _PLAIN)
    free = _free(topic, _TAGS)
    return Words(
        tags=(topic[0].lower(), free[0], free[1]),
        poll=_free(topic, _POLL)[:2],
        slots=("thing", "thing2", "plain", "plain2"),
        link_words="plain",
        channels=tuple(
            name.format(_for_text(plain[n % len(plain)]).title())
            for n, name in enumerate(_CHANNELS)
        ),
        channel_kinds=_kinds(searches, len(_CHANNELS)),
        sayings=_SAYINGS,
        endings=_ENDINGS,
        titles=_TITLES,
        plain_titles=_free(topic, _PLAIN_TITLES),
        about=_free(topic, _ABOUT),
        posts=_POSTS,
        words={"thing": things, "plain": plain},
        foreign={
            language: said
            for language, said in _FOREIGN.items()
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
