"""Lists every kind of video that the pipeline must distinguish, with the expected verdict, and
has the videos and channels of the invented world, as the services show them.

Each case changes a plain video (public, Gaming, labelled with the topic's game, widescreen, minutes
long, manual English captions) in the fewest places. `stage` is the stage that rejects it, None when
it is kept: the tests' own answer sheet. Stages are the contract's.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from typing import Any

from kb.core.config.profile import Profile
from kb.core.languages import primary_language
from kb.sandbox.speech import Cast
from kb.youtube.section import YouTubeSection


@dataclass(frozen=True)
class Track:
    """A caption track. `po_token`: empty for whoever sends no proof-of-origin token."""

    language: str
    kind: str = ""  # "asr" or ""
    translatable: bool = True
    po_token: bool = False


@dataclass(frozen=True)
class Case:
    """One kind of video. `change`: fields of Video; `kind`,
    `evidence`: what its kept row must say.
    """

    name: str
    stage: str | None = None
    reason: str | None = None  # None: the stage's own name for a value out of bounds
    change: dict[str, Any] = field(default_factory=dict)
    kind: str = "manual"
    evidence: str = "game_label"
    often: int = 0  # weight among the videos beyond the first of each case


def _kept(
    name: str, kind: str = "manual", evidence: str = "game_label", often: int = 0, **change: Any
) -> Case:
    return Case(name, None, None, change, kind, evidence, often)


def _out(name: str, stage: str, reason: str | None = None, often: int = 0, **change: Any) -> Case:
    return Case(name, stage, reason, change, often=often)


EN, ASR = Track("en"), Track("en", "asr")

# A domain fills in {topic} and the like, and puts its own numbers in the place of these
# (`CaseRules`).
CASES: list[Case] = [
    _kept("manual", often=18),
    _kept("asr", "asr", often=22, tracks=[ASR]),
    _kept("manual before automatic", often=6, tracks=[ASR, EN]),
    _kept("British English", tracks=[Track("en-GB")], often=2),
    _kept("American English, automatic", "asr", tracks=[Track("en-US", "asr")]),
    _kept("translated from German", "translated", tracks=[Track("de")], often=3),
    _kept("translated from automatic Spanish", "translated", tracks=[Track("es", "asr")], often=2),
    _kept("automatic English before manual Japanese", "asr", tracks=[Track("ja"), ASR], often=2),
    _out("no captions", "transcript", "none", tracks=[], often=5),
    _out(
        "German that can't be translated",
        "transcript",
        "none",
        tracks=[Track("de", translatable=False)],
    ),
    _out("gone between listing and reading", "missing", in_api=False, often=2),
    _out("gone between reading and watching", "transcript", "none", player="gone"),
    _out("age restricted", "age_restricted", rating="ytAgeRestricted", player="age", often=1),
    _out("age restricted, known to the player only", "age_restricted", player="age"),
    _out("another game", "topic", game="other", often=4),
    _kept("no label, topic in the title", evidence="keywords", game=None, often=3),
    _kept(
        "no label, topic in a tag",
        evidence="keywords",
        game=None,
        title="plain",
        tags=["{tag 2}", "{tag 1}"],
        often=1,
    ),
    _kept("label, topic nowhere in the text", title="plain", tags=["{tag 3}"], often=2),
    _out("no label, topic nowhere", "topic", game=None, title="plain", tags=["{tag 3}"], often=2),
    _out(
        "no label, topic only as part of a word",
        "topic",
        game=None,
        title="{joined}esque building, a talk",
        tags=[],
    ),
    _out("music about the topic", "topic", category_id="10", often=1),
    _out("99 views", "views", view_count="99", often=3),
    _kept("100 views", view_count="100"),
    _out("no views yet", "views", view_count="0"),
    _out("views absent", "views", "absent", view_count=None),
    _out("views negative", "views", "malformed", view_count="-5"),
    _out("views empty", "views", "malformed", view_count=""),
    _out("Short", "aspect_ratio", width=1080, height=1920, seconds=41, short=True, often=5),
    _out("vertical", "aspect_ratio", width=1080, height=1920, often=1),
    _kept("square", width=1080, height=1080),
    _out("frame size absent", "aspect_ratio", "absent", sized=False),
    _out("59 seconds", "duration", seconds=59, often=1),
    _kept("60 seconds", seconds=60),
    _out("live now", "duration", duration="P0D", live="live"),
    _out("duration absent", "duration", "absent", duration=None),
    _out("duration malformed", "duration", "malformed", duration="PTXM"),
    _kept("longer than a day", seconds=93_784, duration="P1DT2H3M4S"),
    _kept("likes hidden", like_count=None, often=3),
    _kept("emoji in the title", title="⛏️ {topic} 100% 💎 challenge 🧑‍🚀"),
    _kept("right-to-left title", title="مرحبا {topic} בניית בית"),
    _kept("NUL in the title", title="{topic}\x00 tower tour"),
    _kept("lone surrogate in the title", title="{topic} \ud83d broken emoji"),
    _kept("markup in the title", title='Tips & Tricks <b>for</b> {topic} &amp; "friends"'),
    _kept("free licence", license="creativeCommon", often=2),
    _kept("60 frames a second", fps=60, width=2560, height=1440, often=6),
    _kept("four by three", width=1440, height=1080),
    _kept("no description, no tags", description="", tags=[]),
    _out(
        "insult in the title",
        "toxicity",
        title="{topic} but you are a stupid worthless idiot",
        often=1,
    ),
    _out(
        "insult in the description",
        "toxicity",
        description="shut up you pathetic loser you are a stupid moron",
    ),
]


# In no list and in no search: who asks for it has its id.
UNLISTED = _out("unlisted", "not_public", "unlisted", privacy="unlisted")

MUSIC, NEWS = 10, 25  # categories of what is off topic


@dataclass(frozen=True)
class CaseRules:
    """What a profile says of videos, as far as the cases turn on it."""

    topic: str
    tags: tuple[str, str, str]  # the first one names the topic, the others don't
    language: str = "en"
    category: int = 20
    other_category: int = MUSIC
    labelled: bool = True
    min_views: int = 100
    min_seconds: int = 60
    min_aspect_ratio: float = 1.0
    required: bool = True
    translate: bool = True
    toxicity: bool = True


def rules_of(profile: Profile, tags: tuple[str, str, str]) -> CaseRules:
    """The rules of a profile; the usual ones where it has no [youtube]."""
    section = profile.section_if_any(YouTubeSection)
    if section is None:
        return CaseRules(profile.title, tags)
    return CaseRules(
        topic=section.words[0],
        tags=tags,
        language=section.language,
        category=section.category_ids[0],
        other_category=next(
            category for category in (MUSIC, NEWS, 1, 0) if category not in section.category_ids
        ),
        labelled=bool(section.game_ids),
        min_views=section.min_views,
        min_seconds=math.ceil(section.min_duration_s),
        min_aspect_ratio=section.min_aspect_ratio,
        required=section.transcripts == "required",
        translate=section.translate,
        toxicity=profile.toxicity.threshold("youtube") is not None,
    )


def cases_by(rules: CaseRules) -> list[Case]:
    """The cases in order, without those that the rules leave no room for."""
    made = (_adapted(case, rules) for case in CASES)
    return [case for case in made if case is not None]


def _adapted(case: Case, rules: CaseRules) -> Case | None:
    change = dict(_filled(case.change, rules))
    stage, evidence = case.stage, case.evidence
    if not rules.labelled:
        # Labels decide nothing here, so another one does no harm and none is missed.
        evidence = "keywords"
        if change.get("game") == "other":
            stage = None
        elif "topic nowhere" in case.name:
            stage = "topic"
        change.setdefault("game", None)
    if case.name in _IMPOSSIBLE and rules.min_views < 1:
        return None
    if "view_count" in change and change["view_count"] in ("99", "100"):
        change["view_count"] = str(rules.min_views - (change["view_count"] == "99"))
    if change.get("seconds") in (59, 60):
        change["seconds"] = rules.min_seconds - (change["seconds"] == 59)
    if min(change.get("seconds", 1), rules.min_seconds) < 1:
        return None
    if stage in (None, "aspect_ratio", "transcript", "toxicity") and case.reason != "absent":
        stage = _by_numbers(stage, change, rules)
    if stage == "toxicity" and not rules.toxicity:
        stage = None
    if stage is None and case.kind == "translated" and not rules.translate:
        stage = "transcript"
    if stage == "transcript" and not rules.required:
        stage = None
    return replace(case, change=change, stage=stage, evidence=evidence)


_IMPOSSIBLE = ("99 views", "no views yet")


def _by_numbers(stage: str | None, change: dict[str, Any], rules: CaseRules) -> str | None:
    """Shape and length by the rules, which come before what else is wrong with a video."""
    if change.get("width", 1920) / change.get("height", 1080) < rules.min_aspect_ratio:
        return "aspect_ratio"
    if change.get("seconds", rules.min_seconds) < rules.min_seconds:
        return "duration"
    return None if stage == "aspect_ratio" else stage


def _filled(change: dict[str, Any], rules: CaseRules) -> Iterator[tuple[str, Any]]:
    """The fields with the domain's words, category and languages in them."""
    tags = dict(enumerate(rules.tags, start=1))
    words = {
        "{topic}": rules.topic,
        "{joined}": "".join(rules.topic.split()),
        **{f"{{tag {n}}}": tag for n, tag in tags.items()},
    }
    for name, value in change.items():
        if name == "category_id":
            yield name, str(rules.other_category)
        elif name == "tags":
            yield name, [words.get(tag, tag) for tag in value]
        elif name == "tracks":
            yield name, [_spoken(track, rules.language) for track in value]
        elif isinstance(value, str) and name in ("title", "description"):
            yield name, re.sub(r"\{[a-z]+\}", lambda sign: words[sign[0]], value)
        else:
            yield name, value


def _spoken(track: Track, language: str) -> Track:
    """English stands for the profile's language, and for its own where that is another."""
    if language == "en":
        return track
    base = primary_language(track.language)
    spoken = language if base == "en" else "en" if base == language else track.language
    return replace(track, language=spoken)


@dataclass
class Video:
    """A video. Counts and durations are the API's text; None means that the answer leaves the field
    out.
    """

    id: str
    channel: Channel
    case: Case
    number: int
    cast: Cast  # what it is about
    title: str
    description: str
    published_at: str
    view_count: str | None
    like_count: str | None
    comment_count: str | None
    tags: list[str]
    category_id: str
    language: str  # the domain's, into which every track is translated
    label: tuple[str, str] | None  # browse id and name of what YouTube says that it is about
    seconds: int = 600
    duration: str | None = ""  # "" : made from `seconds`
    width: int = 1920
    height: int = 1080
    fps: int = 30
    sized: bool = True  # whether the API knows the embed's size
    license: str = "youtube"
    privacy: str = "public"
    rating: str | None = None
    live: str = "none"
    in_api: bool = True
    player: str = "ok"  # ok, age, gone
    game: str | None = "topic"
    tracks: list[Track] = field(default_factory=list)
    short: bool = False
    task: str = ""  # what its title says that is done
    task_start: float | None = None  # of its chapter, in s

    @property
    def iso_duration(self) -> str | None:
        """The duration as the API writes it."""
        if self.duration != "":
            return self.duration
        minutes, seconds = divmod(self.seconds, 60)
        hours, minutes = divmod(minutes, 60)
        return (
            "PT"
            + (f"{hours}H" if hours else "")
            + (f"{minutes}M" if minutes else "")
            + (f"{seconds}S" if seconds or not minutes else "")
        )


@dataclass
class Channel:
    """A channel and its uploads, newest first. `listed` False: its uploads playlist answers 404."""

    id: str
    title: str
    description: str
    words: str
    published_at: str
    listed: bool = True
    without_shorts: bool = True  # whether a UULF… playlist exists
    videos: list[Video] = field(default_factory=list)
    entries: list[Video] = field(
        default_factory=list
    )  # as the playlist lists them: one may come twice

    @property
    def uploads(self) -> str:
        """The id of the uploads playlist."""
        return "UU" + self.id[2:]


@dataclass
class Playlist:
    """A playlist that somebody made. `teaches`: of tutorials; `privacy` as the API names it, and
    "gone" of one that was deleted since the search engine saw it.
    """

    id: str
    title: str
    channel: Channel
    entries: list[Video]
    teaches: bool = False
    privacy: str = "public"
