"""Tells memory that ran out from any other failure.

It is one fact with many errors: Python and Arrow's pools raise MemoryError, the system an errno,
DuckDB an error of its own; torch, ONNX Runtime, the loader of libraries and threads that can't
start have only a text for it.
"""

import errno
import sys

from kb.core.errors import KbError

HINT = "try fewer --workers"
_TEXTS = (
    "can't allocate memory",
    "cannot allocate memory",
    "can't start new thread",
    "cannot create thread",
    "out of memory",
    "bad_alloc",
    "bad allocation",
    "failed to alloc",
    "malloc of size",
    "resource temporarily unavailable",
)


def is_out_of_memory(error: BaseException | None) -> bool:
    """Whether an error, or the one that led to it, means that memory ran out."""
    while error is not None:
        if isinstance(error, MemoryError):
            return True
        if isinstance(error, OSError) and error.errno is not None:
            if error.errno in (errno.ENOMEM, errno.EAGAIN):
                return True
        elif _is_generic(error) and any(text in str(error).lower() for text in _TEXTS):
            return True
        error = error.__cause__
    return False


def _is_generic(error: BaseException) -> bool:
    """Whether only the text of an error may tell: what quotes values of the data is of a class that
    says so.
    """
    if isinstance(error, KbError):
        return False
    named = (("pyarrow", "ArrowException"), ("duckdb", "OperationalError"))
    kinds = [getattr(sys.modules.get(name), kind, None) for name, kind in named]
    kinds += [getattr(sys.modules.get("duckdb"), "InternalError", None)]
    return isinstance(error, (RuntimeError, ImportError, OSError, *filter(None, kinds)))
