"""Every kind of video that the pipeline must tell apart, with the verdict that it deserves.

Each case changes a plain video (public, Gaming, labelled with the topic's game, widescreen, minutes
long, manual English captions) in the fewest places. `stage` is the stage that rejects it, None when
it is kept: the tests' own answer sheet. Stages are the contract's.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any


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
# (kb/sandbox/youtube/case_rules.py).
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
