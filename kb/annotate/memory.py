"""What models say when there is no memory for them, in a user's words."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator

from kb.core.errors import FatalError

# torch and ONNX Runtime have no class of their own for it; this is what they write.
_SAID = ("can't allocate memory", "out of memory", "bad_alloc", "bad allocation", "failed to alloc")


@contextlib.contextmanager
def needing() -> Iterator[None]:
    """A block that loads or runs a model. Raises FatalError when memory is too short for it."""
    try:
        yield
    except (MemoryError, RuntimeError, OSError) as error:
        if short(error):
            raise FatalError(
                "there is not enough memory for the toxicity model",
                hint="close what else takes memory, or try fewer --workers;"
                " the same command resumes",
            ) from error
        raise


def short(error: BaseException) -> bool:
    """Whether an error says that memory is short."""
    return isinstance(error, MemoryError) or any(said in str(error).lower() for said in _SAID)
