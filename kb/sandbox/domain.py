"""What an invented world speaks of: made of a profile.

domain_of(profile)     its words, labels, subreddit, wiki and thresholds; the same each time
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any

import msgspec

from kb.core.errors import ProfileError
from kb.core.profile import DEFAULT, Profile, load_profile
from kb.pairs import keywords
from kb.sandbox import made_words
from kb.sandbox.case_rules import Rules, cases_by, rules_of
from kb.sandbox.cases import Case
from kb.sandbox.speech import Speech, Words

OWN = "world.toml"  # words of a profile's own, beside it
OTHER_LABEL = "UCsandboxOtherGame00001a"


@dataclass(frozen=True)
class Domain:
    """One domain. `labels`: browse id and name under a video of the topic and of another one."""

    title: str
    speech: Speech
    rules: Rules
    cases: list[Case]
    labels: dict[str, tuple[str, str]]
    subreddit: str
    min_score: int
    names: tuple[str, ...] = ()  # keywords, for the titles of wiki pages
    namespace: int = 0  # of the wiki's pages
    sprite: str = "sprite"  # classes of the wiki's markup
    sprite_image: str = "sprite-file"
    animation: str = "animated"
    active: str = "animated-active"
    words: Words = field(init=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "words", self.speech.words)


def domain_of(profile: Profile) -> Domain:
    """The domain of a profile. Raises ProfileError for a keyword list that can't be read."""
    listed = keywords.load(profile).every if profile.pairs else ()
    words = _own(profile.beside(OWN)) or made_words.words_of(profile, listed)
    rules = rules_of(profile, words)
    reddit, youtube = profile.reddit, profile.youtube
    game = youtube.game_ids[0] if youtube and youtube.game_ids else ""
    return Domain(
        title=profile.title,
        speech=Speech(words, rules.topic),
        rules=rules,
        cases=cases_by(rules),
        labels={"topic": (game, profile.title), "other": (OTHER_LABEL, words.other_label)},
        subreddit=reddit.subreddit if reddit else "sandbox",
        min_score=reddit.min_score if reddit else 5,
        names=made_words.names(profile, listed),
        **_wiki(profile),
    )


@cache
def usual() -> Domain:
    """The domain of the default profile."""
    return domain_of(load_profile(DEFAULT))


def _own(path: Path) -> Words | None:
    try:
        return msgspec.toml.decode(path.read_bytes(), type=Words)
    except FileNotFoundError:
        return None
    except (msgspec.DecodeError, OSError, UnicodeDecodeError) as error:
        raise ProfileError(f"the words of the invented world, {path}: {error}") from None


def _wiki(profile: Profile) -> dict[str, Any]:
    """What the wiki's pages bear: a namespace, and the first class of each selector."""
    if profile.wiki is None:
        return {}
    markup = profile.wiki.markup
    found = {
        "sprite": made_words.first_class(markup.sprite),
        "sprite_image": made_words.first_class(markup.sprite_image),
        "animation": made_words.first_class(markup.animation),
        "active": markup.animation_active,
    }
    named = {name: value for name, value in found.items() if value}
    read = profile.wiki.namespaces
    return {**named, "namespace": read[0] if read and 0 not in read else 0}
