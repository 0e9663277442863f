"""Lorecrawl: builds open knowledge bases about a domain from YouTube, a wiki and Reddit.

import kb
data = kb.load("release/")      # a release, or a whole data root: see kb.reader
"""

from __future__ import annotations

import os
from typing import TYPE_CHECKING, Any

from kb.core.startup import ENVIRONMENT
from kb.version import __version__

if TYPE_CHECKING:
    from kb.reader import load

__all__ = ["__version__", "load"]

os.environ |= ENVIRONMENT
# Arrow's own pool returns large blocks at once: a third of decoding went into asking the kernel for
# them again. Whoever has chosen a pool keeps it.
os.environ.setdefault("ARROW_DEFAULT_MEMORY_POOL", "system")


def __getattr__(name: str) -> Any:
    """Loaded when asked for, so that `kb --help` stays quick."""
    if name == "load":
        from kb.reader import load  # noqa: PLC0415

        return load
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    """What is offered by completion: `load` as well, before it was asked for."""
    return sorted({*globals(), *__all__})
