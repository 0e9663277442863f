"""Data roots made by `kb demo`: what other commands have to know about them."""

from __future__ import annotations

from typing import TYPE_CHECKING

from kb.core.errors import MissingExtra

if TYPE_CHECKING:
    from pathlib import Path

    from kb.core.config.profile import Profile
    from kb.core.config.settings import Settings


def in_demo_root(root: Path, settings: Settings, profile: Profile) -> tuple[Settings, Profile]:
    """Settings and profile for another command in a demo's root; unchanged in any other root.

    The root's scores are the tiny model's, so that model is used again unless the user names
    another. Scoring stays off where the demo had to do without the model.
    """
    from kb.store.state import demo_mark

    if demo_mark.read(root) is None or "kb_toxicity_model" in settings.model_fields_set:
        return settings, profile
    from kb.sandbox import toxicity

    try:
        model = str(toxicity.tiny_checkpoint())
    except MissingExtra:
        return settings, without_scores(profile)
    return settings.model_copy(update={"kb_toxicity_model": model}), profile


def without_scores(profile: Profile) -> Profile:
    """The profile with toxicity scoring switched off."""
    off = profile.toxicity.model_copy(update={"toxicity": "off"})
    return profile.model_copy(update={"toxicity": off})
