"""[wiki] of a profile."""

from __future__ import annotations

from kb.core.profile.base import Section


class Wiki(Section):
    """The wiki part of a profile."""
