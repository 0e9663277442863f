"""[reddit] of a profile."""

from __future__ import annotations

from kb.core.profile.base import Section


class Reddit(Section):
    """The reddit part of a profile."""
