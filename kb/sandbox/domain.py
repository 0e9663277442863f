"""Derives the vocabulary and rules of an invented world from a profile.

domain_of(profile)     its names, labels, subreddit, wiki and thresholds; the same each time
"""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any

import msgspec

from kb.core import clock
from kb.core.config.profile import DEFAULT, Profile, load_profile
from kb.core.errors import ProfileError
from kb.pairs import keywords
from kb.pairs.keyword_list import NEVER, Keyword
from kb.reddit.section import RedditSection
from kb.sandbox.speech import Speech, grammar, names_topic
from kb.sandbox.youtube.cases import Case, CaseRules, cases_by, rules_of
from kb.wiki.section import WikiSection
from kb.youtube.section import YouTubeSection

OWN = "world.toml"  # a profile's own choice of names, beside it
OTHER_LABEL = "UCsandboxOtherGame00001a"
_CERTAIN, _EVERYDAY = 45, 15  # most keywords of each kind that are spoken of

# The classes of what facts and recipes are read from, by the profile's names of their selectors;
# a wiki whose profile names no grid has no recipes.
CLASSES = {
    "infobox": "infobox",
    "recipe": "",
    "slot": "",
    "slot_row": "",
    "slot_output": "",
    "quantity": "",
}


class Choice(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A profile's `world.toml`: keywords, the most frequent first."""

    names: tuple[str, ...] = ()
    recorded_wiki: bool = False


@dataclass(frozen=True)
class Domain:
    """One domain. `labels`: browse id and name under a video of the topic and of another one."""

    title: str
    speech: Speech
    rules: CaseRules
    cases: list[Case]
    labels: dict[str, tuple[str, str]]
    subreddit: str
    min_score: int
    channels: tuple[str, ...]  # their names
    channel_kinds: tuple[str, ...]  # what each says that it is about
    keywords: tuple[Keyword, ...] = ()  # what is spoken of, the most frequent first
    phrases: tuple[str, ...] = ()  # that find playlists
    recorded_wiki: bool = False
    namespace: int = 0  # of the wiki's pages
    sprite: str = "sprite"  # classes of the wiki's markup
    sprite_image: str = "sprite-file"
    animation: str = "animated"
    active: str = "animated-active"
    classes: Mapping[str, str] = field(default_factory=lambda: dict(CLASSES))
    stations: Mapping[str, str] = field(default_factory=dict)  # of recipes, with a word of each


def domain_of(profile: Profile) -> Domain:
    """The domain of a profile. Raises ProfileError for a keyword list that can't be read."""
    choice = _choice(profile.resolve_file(OWN))
    youtube, reddit = profile.section_if_any(YouTubeSection), profile.section_if_any(RedditSection)
    topic = tuple(youtube.words) if youtube else (profile.title,)
    listed = keywords.load(profile).every if profile.pairs else ()
    spoken = [
        keyword for keyword in _spoken(listed, choice.names) if not names_topic(topic, keyword.name)
    ]
    names = [keyword.name for keyword in spoken] or list(grammar().nouns)
    # Tags of a video: the topic, and two that don't name it.
    free = [tag for tag in grammar().tags if not names_topic(topic, tag)]
    tags = (topic[0].lower(), *(free if len(free) > 1 else grammar().tags)[:2])
    rules = rules_of(profile, tags)
    verbs = [forms.split()[0] for forms in profile.tasks.verbs]
    game = youtube.game_ids[0] if youtube and youtube.game_ids else ""
    searches = youtube.keywords if youtube else (profile.title,)
    return Domain(
        title=profile.title,
        speech=Speech(
            names, topic, rules.language, verbs, profile.tasks.things, profile.tasks.nouns
        ),
        rules=rules,
        cases=cases_by(rules),
        labels={"topic": (game, profile.title), "other": (OTHER_LABEL, "Something Else")},
        subreddit=reddit.subreddit if reddit else "sandbox",
        min_score=reddit.min_score if reddit else 5,
        channels=tuple(
            template.format(names[place % len(names)].removeprefix("The "))
            for place, template in enumerate(grammar().channels)
        ),
        channel_kinds=_kinds(searches, len(grammar().channels)),
        keywords=tuple(spoken),
        phrases=youtube.playlist_keywords if youtube else (),
        recorded_wiki=choice.recorded_wiki,
        **_wiki(profile),
    )


@cache
def usual() -> Domain:
    """The domain of the default profile."""
    return domain_of(load_profile(DEFAULT))


def _choice(path: Path) -> Choice:
    try:
        return msgspec.toml.decode(path.read_bytes(), type=Choice)
    except FileNotFoundError:
        return Choice()
    except (msgspec.DecodeError, OSError, UnicodeDecodeError) as error:
        raise ProfileError(f"the words of the invented world, {path}: {error}") from None


def _spoken(listed: Sequence[Keyword], names: Sequence[str]) -> list[Keyword]:
    """The keywords of these names, or else some of the list, everyday words last."""
    if names:
        by_name = {keyword.name: keyword for keyword in listed}
        return [by_name[name] for name in names if name in by_name]
    rng = clock.rng("words of the invented world")
    # What is in no sentence of ours: a brace would be read as a slot.
    fit = [keyword for keyword in listed if not re.search(r"[{}]", keyword.name)]
    certain = [keyword for keyword in fit if keyword.reach is None]
    everyday = [
        keyword for keyword in fit if keyword.reach not in (None, NEVER) and keyword.rule != "topic"
    ]
    return [
        *rng.sample(certain, min(len(certain), _CERTAIN)),
        *rng.sample(everyday, min(len(everyday), _EVERYDAY)),
    ]


def _kinds(searches: Sequence[str], channels: int) -> tuple[str, ...]:
    """What each channel says that it is about: every search finds some."""
    if len(searches) <= channels:
        return tuple(searches)
    return tuple(" ".join(searches[n::channels]) for n in range(channels))


def _wiki(profile: Profile) -> dict[str, Any]:
    """What the wiki's pages bear: a namespace, and the first class of each selector."""
    if (wiki := profile.section_if_any(WikiSection)) is None:
        return {}
    markup = wiki.markup
    values = {
        "sprite": _first_class(markup.sprite),
        "sprite_image": _first_class(markup.sprite_image),
        "animation": _first_class(markup.animation),
        "active": markup.animation_active,
    }
    named: dict[str, Any] = {name: value for name, value in values.items() if value}
    selectors = {**markup.model_dump(), "infobox": markup.regions.get("infobox", "")}
    given = {name: _first_class(selectors[name]) for name in CLASSES}
    named["classes"] = {name: given[name] or plain for name, plain in CLASSES.items()}
    named["stations"] = {name: words[0] for name, words in markup.stations.items() if words}
    read = wiki.namespaces
    return {**named, "namespace": read[0] if read and 0 not in read else 0}


def _first_class(selector: str) -> str:
    """The first class that a CSS selector names, if it does."""
    match = re.search(r"\.([A-Za-z_][\w-]*)", selector)
    return match[1] if match else ""


def signed(profile: Profile) -> Profile:
    """The profile with the default profile's contact, creator and licences where it has none, as
    the world is invented.
    """
    section, default = profile.release, load_profile(DEFAULT).release
    lacking = section.unsigned()
    given: dict[str, Any] = {}
    if "a contact" in lacking:
        given["contact"] = default.contact
    if "a creator" in lacking:
        given["creators"] = default.creators
    if unlicensed := section.unlicensed():
        licences = {name: default.licence_of(name) for name in unlicensed}
        given["licenses"] = licences | section.licenses
    if not given:
        return profile
    return profile.model_copy(update={"release": section.model_copy(update=given)})
