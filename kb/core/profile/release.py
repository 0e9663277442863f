"""[release] of a profile."""

from __future__ import annotations

from kb.core.profile.base import Section


class Release(Section):
    """The release part of a profile."""
