"""What to do about an error, where a notebook shows it.

The command line prints an error's hint under it; a traceback knows only of notes.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import wraps
from typing import ParamSpec, TypeVar

from kb.core.errors import KbError

P = ParamSpec("P")
T = TypeVar("T")


def hinted(function: Callable[P, T]) -> Callable[P, T]:
    """The function, whose errors show their hints in tracebacks."""

    @wraps(function)
    def inner(*args: P.args, **kwargs: P.kwargs) -> T:
        try:
            return function(*args, **kwargs)
        except KbError as error:
            if error.hint and error.hint not in getattr(error, "__notes__", ()):
                error.add_note(error.hint)
            raise

    return inner
