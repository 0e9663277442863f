"""What one command run carries: settings, profile, data root, options and where progress goes."""

from __future__ import annotations

import os
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from kb.core.progress import Progress

if TYPE_CHECKING:  # commands name the Run in their signatures; `kb --help` loads no pydantic
    from pathlib import Path

    from kb.core.config.profile import Profile
    from kb.core.config.settings import Settings


def default_workers() -> int:
    """As many workers as cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


# Bytes that one process has read by the time that another has started: that takes a second, for
# what its tasks import, and a filter reads some 8 MiB of raw answers in a second.
_SMALL = 8 << 20


@dataclass(frozen=True)
class Run:
    """Passed to every command function. Options are the contract's common options.

    `asked`: the number of `workers` was asked for, and is not what the machine has.
    """

    settings: Settings
    profile: Profile
    root: Path
    workers: int = field(default_factory=default_workers)
    asked: bool = True
    limit: int | None = None
    wait: bool = False
    again: bool = False
    engine: str = "local"
    scheduler: str | None = None
    progress: Progress = field(default_factory=Progress)

    def processes(self, size: int) -> int:
        """How many worker processes are worth starting for `size` bytes of files; a cluster's are
        there.
        """
        few = self.engine == "local" and not self.asked and size <= _SMALL
        return 1 if few else self.workers

    @property
    def seed(self) -> int:
        """Seed of every random choice."""
        return self.profile.seed
