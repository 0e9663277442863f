"""Hints of errors as Python says them."""

import re
from collections.abc import Callable
from functools import wraps
from typing import ParamSpec, TypeVar

from kb.core.errors import KbError

# Hints that name commands or options, and what they are in Python.
_IN_PYTHON = (
    (r"`kb query --tables` lists the views", "data.tables lists the tables"),
    (r'kb search "(.+)"', r'data.search("\1")'),
    (r"did you mean --data (.+)\?", r'did you mean kb.load("\1")?'),
    (r"check --data and KB_DATA", "check the folder that was given to kb.load"),
    (r"give (.+) as --data\b", r"give kb.load \1"),
)


P = ParamSpec("P")
T = TypeVar("T")


def with_hints(function: Callable[P, T]) -> Callable[P, T]:
    """Adds the hints of a function's errors, as Python says them, to tracebacks, which show notes
    only.
    """

    @wraps(function)
    def inner(*args: P.args, **kwargs: P.kwargs) -> T:
        try:
            return function(*args, **kwargs)
        except KbError as error:
            for command, python in _IN_PYTHON:
                error.hint = re.sub(command, python, error.hint)
            if error.hint and error.hint not in getattr(error, "__notes__", ()):
                error.add_note(error.hint)
            raise

    return inner
