"""One error for the many ways in which model runtimes report that memory is short."""

import contextlib
from collections.abc import Iterator

from kb.core.errors import FatalError

# torch and ONNX Runtime raise generic errors with these texts.
_TEXTS = (
    "can't allocate memory",
    "out of memory",
    "bad_alloc",
    "bad allocation",
    "failed to alloc",
)


@contextlib.contextmanager
def explained() -> Iterator[None]:
    """Wrap code that loads or runs a model. Raises FatalError when memory runs out."""
    try:
        yield
    except (MemoryError, RuntimeError, OSError) as error:
        if is_out_of_memory(error):
            raise FatalError(
                "not enough memory for the toxicity model",
                hint="close other programs or use fewer --workers; the same command resumes",
            ) from error
        raise


def is_out_of_memory(error: BaseException) -> bool:
    """Whether an error means that memory ran out."""
    return isinstance(error, MemoryError) or any(text in str(error).lower() for text in _TEXTS)
