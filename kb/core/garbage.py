"""How often Python looks for garbage that refers to itself."""

from __future__ import annotations

import gc


def seldom() -> None:
    """Every 20,000 new objects and not every 700: each import makes thousands that stay, rows are
    Arrow's, and what refers to itself is little. A tenth of a command's start and of a report.
    """
    gc.set_threshold(20_000, 20, 20)
