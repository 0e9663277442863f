"""Which errors are tried again, how often, and how long to wait in between: one policy for every
service.

Retryable    backoff with full jitter, or the service's own wish (Retry-After)
others       leave at once: final for the item, stop the stage, or end the run
"""

from __future__ import annotations

import math
import os
from collections.abc import Callable
from datetime import UTC, datetime, timedelta
from email.utils import parsedate_to_datetime
from typing import TypeVar

from kb.core import clock
from kb.core.errors import Blocked, Retryable, Unreachable
from kb.core.installation import tenacity

Note = Callable[..., None]
"""Notes what became of a request: (outcome, *, sent=True)."""

Result = TypeVar("Result")

TRIES = 5
FIRST_S, LONGEST_S = 0.5, 60.0
PATIENCE_S = 300.0  # a longer Retry-After is no hiccup: the run stops and goes on another time
ADVICE_S = 3600.0  # when to come back to a service that blocks us and names no time
_YEAR = 366 * 24 * 3600.0  # seconds; a longer Retry-After is read as this


def attempt(
    call: Callable[[], Result],
    *,
    tries: int = TRIES,
    patience: float = PATIENCE_S,
    sleep: Callable[[float], None] | None = None,
    service: str | None = None,
) -> Result:
    """The result of `call`, tried again while it raises Retryable, at most `tries` times in all.

    After the last try the Retryable itself: the item failed, and the next run tries it again.
    Raises Blocked when the service asks to wait longer than `patience` seconds, or turns every try
    away (429). `sleep` waits between the tries instead of the clock's, and may raise. `service`
    names a service without which nothing goes on: what fails to the end is Unreachable then.
    """

    def wait(state: tenacity.RetryCallState) -> float:
        error = state.outcome.exception() if state.outcome else None
        after = getattr(error, "after", None)
        if after is not None and after > patience:
            raise blocked(f"the service asks to wait {after:.0f} s ({error})", after)
        return backoff(state.attempt_number, after)

    retrying = tenacity.Retrying(
        stop=tenacity.stop_after_attempt(tries),
        retry=tenacity.retry_if_exception_type(Retryable),
        wait=wait,
        sleep=sleep or clock.sleep,
        reraise=True,
    )
    try:
        return retrying(call)
    except Retryable as error:
        if error.throttled:
            stop = blocked(
                f"the service rejects requests {tries} times in a row ({error})",
                error.after,
                waited=patience > PATIENCE_S,
            )
            stop.after = error.after or min(patience, PATIENCE_S)
            raise stop from error
        if service is not None and error.unreachable:
            raise Unreachable(
                f"no connection after {tries} tries: {error.reason}",
                hint="check the network; the same command resumes",
            ) from error
        if service is not None:
            raise Unreachable(
                f"{service} returns no usable answer: {error.reason}",
                hint="the same command resumes",
            ) from error
        raise


def blocked(what: str, after: float | None = None, *, waited: bool = False) -> Blocked:
    """The error for a service that rejects requests; it may name the seconds to wait (`after`).

    `waited`: to wait for that did not help, or would not.
    """
    back = clock.now() + timedelta(seconds=min(after or ADVICE_S, 1e9))
    then = clock.stamp(back)
    if after:
        hint = f"run the same command after {then}" + ("" if waited else ", or add --wait")
    else:
        hint = f"it names no time; try again after {then}, or from another address"
    return Blocked(what, hint=hint, after=after, until=back)


def backoff(number: int, after: float | None = None) -> float:
    """Seconds to wait after try `number` (from 1): the service's wish, or a random part of a
    doubling span.

    Never less than half the span, so that a service in trouble is really left alone.
    """
    if after is not None:
        return max(0.0, after)
    span: float = min(LONGEST_S, FIRST_S * 2 ** (number - 1))
    drawn = clock.rng("backoff", os.getpid(), clock.monotonic(), number)
    return span * drawn.uniform(0.5, 1.0)


def retry_after(value: str | None, sent: str | None = None) -> float | None:
    """Seconds of a Retry-After header, a number or a date, at most a year; None when absent or
    unreadable.

    `sent` is the answer's Date header: a date counts from there, whatever the clocks say.
    """
    if not value:
        return None
    try:
        return min(max(0.0, float(value)), _YEAR) if math.isfinite(float(value)) else None
    except ValueError:
        pass
    moment = _moment(value)
    if moment is None:
        return None
    return min(max(0.0, (moment - (_moment(sent) or clock.now())).total_seconds()), _YEAR)


def _moment(value: str | None) -> datetime | None:
    """A date of a header (UTC); None when absent or unreadable."""
    try:
        moment = parsedate_to_datetime(value or "")
    except (TypeError, ValueError):
        return None
    return moment if moment.tzinfo else moment.replace(tzinfo=UTC)
