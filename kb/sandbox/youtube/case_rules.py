"""The cases of kb/sandbox/youtube/cases.py in a domain: its words, categories, languages and
thresholds in them, and the verdict that each deserves by its rules.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

from kb.core.profile import Profile
from kb.core.profile.youtube import YouTubeSection
from kb.sandbox.youtube.cases import CASES, Case, Track

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
    section = profile.youtube
    if section is None:
        return CaseRules(profile.title, tags)
    return CaseRules(
        topic=section.words[0],
        tags=tags,
        language=section.language,
        category=section.category_ids[0],
        other_category=_other(section),
        labelled=bool(section.game_ids),
        min_views=section.min_views,
        min_seconds=math.ceil(section.min_duration_s),
        min_aspect_ratio=section.min_aspect_ratio,
        required=section.transcripts == "required",
        translate=section.translate,
        toxicity=profile.toxicity.threshold("youtube") is not None,
    )


def _other(section: YouTubeSection) -> int:
    return next(one for one in (MUSIC, NEWS, 1, 0) if one not in section.category_ids)


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
    held = {
        "{topic}": rules.topic,
        "{joined}": "".join(rules.topic.split()),
        **{f"{{tag {n}}}": tag for n, tag in tags.items()},
    }
    for name, value in change.items():
        if name == "category_id":
            yield name, str(rules.other_category)
        elif name == "tags":
            yield name, [held.get(tag, tag) for tag in value]
        elif name == "tracks":
            yield name, [_spoken(track, rules.language) for track in value]
        elif isinstance(value, str) and name in ("title", "description"):
            yield name, re.sub(r"\{[a-z]+\}", lambda sign: held[sign[0]], value)
        else:
            yield name, value


def _spoken(track: Track, language: str) -> Track:
    """English stands for the profile's language, and for its own where that is another."""
    if language == "en":
        return track
    base = track.language.split("-")[0]
    spoken = language if base == "en" else "en" if base == language else track.language
    return replace(track, language=spoken)
