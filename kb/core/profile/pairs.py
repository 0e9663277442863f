"""[pairs] of a profile."""

from __future__ import annotations

from kb.core.profile.base import Section


class Pairs(Section):
    """The pairs part of a profile."""
