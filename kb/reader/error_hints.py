"""Adds the hints of errors to tracebacks, which show notes only."""

from collections.abc import Callable
from functools import wraps
from typing import ParamSpec, TypeVar

from kb.core.errors import KbError

P = ParamSpec("P")
T = TypeVar("T")


def with_hints(function: Callable[P, T]) -> Callable[P, T]:
    """Decorate a function so that its errors show their hints in tracebacks."""

    @wraps(function)
    def inner(*args: P.args, **kwargs: P.kwargs) -> T:
        try:
            return function(*args, **kwargs)
        except KbError as error:
            if error.hint and error.hint not in getattr(error, "__notes__", ()):
                error.add_note(error.hint)
            raise

    return inner
