"""The one place where time, sleep and randomness come from.

`KB_NOW` sets the date (dates in data, quota days); waiting always uses the monotonic clock. KB_NOW
is frozen; `sleep_until` advances it, so that whoever waits for midnight finds the next day.
"""

import hashlib
import os
import random
import time
from datetime import UTC, datetime, timedelta

from kb.core import signals
from kb.core.errors import SettingError

# What comes from outside is taken for a time in between: every library holds it, and days can be
# added to it.
FIRST, LAST = datetime(1970, 1, 1, tzinfo=UTC), datetime(2200, 12, 31, 23, 59, 59, tzinfo=UTC)

_passed = timedelta()  # while waiting for a date


def parse(text: str) -> datetime:
    """An ISO 8601 time or date as an aware UTC datetime. Raises ValueError."""
    moment = datetime.fromisoformat(text)
    return moment.replace(tzinfo=UTC) if moment.tzinfo is None else moment.astimezone(UTC)


def now() -> datetime:
    """The current time (UTC, whole seconds), or `KB_NOW`."""
    fixed = os.environ.get("KB_NOW", "").strip()
    if not fixed:
        return datetime.now(UTC).replace(microsecond=0)
    try:
        return parse(fixed) + _passed
    except ValueError:
        raise SettingError(
            f"KB_NOW is {fixed!r}, not a time", hint="write it like 2026-11-20T12:00:00Z"
        ) from None


def since_1970(seconds: float) -> datetime | None:
    """So many seconds after the beginning of 1970; None beyond FIRST and LAST."""
    if not 0 <= seconds <= LAST.timestamp():  # NaN too
        return None
    return datetime.fromtimestamp(seconds, UTC)


def stamp(moment: datetime | None = None) -> str:
    """A time as text, "2026-11-20T12:00:00Z"; now when none is given."""
    return (moment or now()).astimezone(UTC).strftime("%Y-%m-%dT%H:%M:%SZ")


def monotonic() -> float:
    """Seconds that only ever grow; for waiting and rates."""
    return time.monotonic()


def sleep(seconds: float) -> None:
    """Wait, ending early with Interrupted when a signal asks us to stop."""
    if seconds > 0:
        signals.stop.wait(seconds)
    signals.stop.raise_if_asked()


def sleep_until(moment: datetime) -> None:
    """Wait until `now()` has come to `moment`, ending early with Interrupted when a signal asks us
    to stop.
    """
    global _passed
    while (seconds := (moment - now()).total_seconds()) > 0:
        step = min(seconds + 1, 60.0)  # now() knows whole seconds only
        sleep(step)
        _passed += timedelta(seconds=step)


def rng(*parts: object) -> random.Random:
    """A random generator seeded by `parts` alone, the same on every machine and Python."""
    text = "\x1f".join(str(part) for part in parts)
    return random.Random(int.from_bytes(hashlib.sha256(text.encode()).digest()[:16], "big"))
