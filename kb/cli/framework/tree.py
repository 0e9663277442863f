"""Finds commands by their words, for messages and the demo: kb.cli.app, which imports every
command, sets how.
"""

from collections.abc import Callable, Sequence
from typing import Any

Finder = Callable[[Sequence[str]], Any | None]
_finders: list[Finder] = []


def set_finder(finder: Finder) -> None:
    """Let `find_command` ask this function."""
    _finders[:] = [finder]


def find_command(words: Sequence[str]) -> Any | None:
    """The click command that a line (without its `kb`) begins with; None where there is none."""
    return next((finder(words) for finder in _finders), None)
