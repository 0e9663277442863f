"""[toxicity] of a profile."""

from __future__ import annotations

from kb.core.profile.base import Section


class Toxicity(Section):
    """The toxicity part of a profile."""
