"""A property that is computed once, whatever number of threads asks for it at the same time."""

from __future__ import annotations

import functools
import threading
from typing import TYPE_CHECKING, Any, TypeVar

if TYPE_CHECKING:
    from collections.abc import Callable

T_co = TypeVar("T_co", covariant=True)


class cached_property(functools.cached_property[T_co]):
    """`functools.cached_property` with the lock that Python's own has no more from 3.12 on: ten
    requests to a service would compute its world ten times, beside each other.
    """

    def __init__(self, compute: Callable[[Any], T_co]) -> None:
        super().__init__(compute)
        self._computing = threading.RLock()

    if not TYPE_CHECKING:  # the types are those of Python's own

        def __get__(self, instance, owner=None):
            """Asked once an instance: from then on the value stands in its `__dict__`."""
            with self._computing:
                return super().__get__(instance, owner)
