"""[report] of a profile."""

from __future__ import annotations

from kb.core.profile.base import Section


class Report(Section):
    """The report part of a profile."""
