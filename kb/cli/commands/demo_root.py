"""A data root that `kb demo` made, for the commands that go on in it."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from pathlib import Path

    from kb.core.profile import Profile
    from kb.core.settings import Settings

FINISHED = "demo-finished"  # a file in the root of a demo that was finished


def carried_on(root: Path, settings: Settings, profile: Profile) -> tuple[Settings, Profile]:
    """Settings and profile for more work in a demo's root: its scores are the tiny model's, so
    that model goes on there unless the user names another; off where the demo had to leave it out.
    """
    from kb.core.errors import MissingExtra
    from kb.sandbox import toxicity

    if not (root / FINISHED).exists() or "kb_toxicity_model" in settings.model_fields_set:
        return settings, profile
    try:
        model = str(toxicity.tiny_checkpoint())
    except MissingExtra:
        return settings, without_scores(profile)
    return settings.model_copy(update={"kb_toxicity_model": model}), profile


def without_scores(profile: Profile) -> Profile:
    off = profile.toxicity.model_copy(update={"toxicity": "off"})
    return profile.model_copy(update={"toxicity": off})
