"""What one command run carries: settings, profile, data root, options and where progress goes."""

from __future__ import annotations

import os
from dataclasses import dataclass, field
from pathlib import Path

from kb.core.profile import Profile
from kb.core.progress import Progress, Silent
from kb.core.settings import Settings


def default_workers() -> int:
    """As many workers as cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


@dataclass(frozen=True)
class Run:
    """Passed to every command function. Options are the contract's common options."""

    settings: Settings
    profile: Profile
    root: Path
    workers: int = field(default_factory=default_workers)
    limit: int | None = None
    wait: bool = False
    again: bool = False
    engine: str = "local"
    scheduler: str | None = None
    pipeline: str | None = None
    progress: Progress = field(default_factory=Silent)

    @property
    def seed(self) -> int:
        """Seed of every random choice."""
        return self.profile.seed
