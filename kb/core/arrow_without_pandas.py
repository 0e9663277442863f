"""Arrow without pandas: what a worker does not use it does not load.

The first `pyarrow.array()` of a process asks pandas, where it is installed, whether it was given
one of its objects: 0.8 s and 60 MB in each worker, for nothing.
"""

import sys
from importlib.abc import MetaPathFinder
from importlib.machinery import ModuleSpec
from typing import Any

import pyarrow as pa


class _NotHere(MetaPathFinder):
    """Says of pandas that it is not installed."""

    def find_spec(self, name: str, path: Any, target: Any = None) -> ModuleSpec | None:
        if name == "pandas":
            raise ModuleNotFoundError("pandas is not needed here", name=name)
        return None


def without_pandas() -> None:
    """Let Arrow ask while pandas can't be found: it remembers the answer. `to_pandas` asks again,
    and whoever imports pandas gets it. For workers and commands alone: in a notebook Arrow would
    take NaN of a pandas column for a number.
    """
    if "pandas" in sys.modules:
        return
    finder = _NotHere()
    sys.meta_path.insert(0, finder)
    try:
        pa.array([])
    finally:
        sys.meta_path.remove(finder)
