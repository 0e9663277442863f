"""Every error that Lorecrawl raises on purpose, sorted by what follows from it.

KbError                     exit  what follows
├── UsageError              2     nothing was sent or written
│   ├── SettingError              a setting or option has a wrong value
│   ├── ProfileError              a profile can't be read, or has a wrong key or value
│   │   └── NotReleasable         it names no licence, creator or contact of a release
│   ├── MissingCredential         a key that the command needs is not set
│   ├── MissingExtra              an optional package is not installed
│   ├── MissingModel              a model file is absent, cut off or another one
│   ├── NewerVersion              a newer version of Lorecrawl wrote the data root
│   └── OtherService              the data root belongs to another host, subreddit or wiki
├── FatalError              1     the run ends; what is on disk stays good
│   ├── CredentialRefused         the service does not accept the key
│   ├── WriterLocked              another process writes to this source
│   ├── CountMismatch             crawled ≠ kept + rejected + failed + pending
│   ├── SchemaMismatch            a table differs from its declaration in schemas/
│   ├── DamagedData               a file on disk can't be read
│   ├── NothingRead               every item of a crawl failed or was refused
│   ├── NothingKept               a filter kept no row
│   └── ReleaseRefused            the gate found something that may not be published
├── Stopped                 3     it passes with time; the same command resumes
│   ├── QuotaSpent                a quota is used up
│   ├── Blocked                   the service limits our address for a time (429 without end)
│   ├── LimitReached              --limit items were done
│   ├── Interrupted               SIGINT or SIGTERM
│   └── ActionNeeded        4     somebody has to act first; then the same command resumes
│       ├── Challenged            captcha, consent wall, challenge page, crawlers turned away
│       ├── Untrusted             the certificate of a service is not trusted
│       ├── Unreachable           no connection to the service after all tries
│       └── DiskFull              no space left to write
└── ItemError               -     about one item; never leaves a stage
    ├── ItemFinal                 a fact about the item: recorded, not tried again
    ├── Retryable                 may go well next time: backoff, then `failed`
    └── Postponed                 may go well later in this run, after the other items
"""

from collections.abc import Iterable
from datetime import datetime
from pathlib import Path
from typing import Any


class KbError(Exception):
    """Base of all. `str(error)` is one line for the user; `hint` says what to do."""

    exit_code = 1
    summary: dict[str, Any] | None = None  # what was done until then; the command line prints it

    def __init__(self, message: str, *, hint: str = "") -> None:
        super().__init__(message)
        self.hint = hint


class UsageError(KbError):
    """Wrong usage, setting or missing part, found before anything was sent or written."""

    exit_code = 2


class SettingError(UsageError):
    """A setting or option has a wrong value."""


class ProfileError(UsageError):
    """A profile can't be read, or a key or value in it is wrong."""


class NotReleasable(ProfileError):
    """The profile does not say what only the owner of a release can: licence, creator, contact."""


class MissingCredential(UsageError):
    """A credential that the command needs is not set."""


class MissingExtra(UsageError):
    """An optional package is not installed, or a program that it needs."""


class MissingModel(UsageError):
    """A model file is absent, cut off, or not the one it should be."""


class NewerVersion(UsageError):
    """A newer version of Lorecrawl wrote the data root, in a form that this one does not know."""


class OtherService(UsageError):
    """The data root holds another host's data; mixing them would spoil both."""


class FatalError(KbError):
    """The run ends here; what is on disk stays good."""


class CredentialRefused(FatalError):
    """The service does not accept the credential."""


class WriterLocked(FatalError):
    """Another process writes to the same source of the same data root."""


class CountMismatch(FatalError):
    """Rows were lost or doubled: crawled differs from the sum of the verdicts."""


class SchemaMismatch(FatalError):
    """A table differs from its declaration in schemas/."""


class DamagedData(FatalError):
    """A file under the data root can't be read. `paths` are the files that it is about, where they
    are known.
    """

    def __init__(self, message: str, *, hint: str = "", paths: Iterable[Path] = ()) -> None:
        super().__init__(message, hint=hint)
        self.paths = tuple(paths)


class NothingRead(FatalError):
    """Every item that a crawl asked for failed or was refused."""


class NothingKept(FatalError):
    """Every row failed or was rejected by a filter; the tables are written all the same."""


class ReleaseRefused(FatalError):
    """The release gate found something that may not be published: `problems`, a line each."""

    def __init__(self, message: str, *, hint: str = "", problems: Iterable[str] = ()) -> None:
        super().__init__(message, hint=hint)
        self.problems = list(problems)


class Stopped(KbError):
    """Stopped early: the same command resumes, and nobody has to act.

    `until`: from when on it may resume (UTC), if known.
    """

    exit_code = 3
    needs = "next run"  # what the same command waits for

    def __init__(self, message: str, *, hint: str = "", until: datetime | None = None) -> None:
        super().__init__(message, hint=hint)
        self.until = until

    @property
    def waits_for(self) -> str:
        """What the same command waits for: "quota until 2026-11-21T08:00:00Z", "disk space"."""
        return f"{self.needs} until {self.until:%Y-%m-%dT%H:%M:%SZ}" if self.until else self.needs


class ActionNeeded(Stopped):
    """Stopped early: the same command resumes after somebody has acted, as `hint` says."""

    exit_code = 4
    needs = "person"


class QuotaSpent(Stopped):
    """A quota is used up. `until` is when the service gives new units."""

    needs = "quota"


class Blocked(Stopped):
    """The service limits us for a time. Never a fact about an item.

    `after`: the seconds that --wait sleeps; None where to wait does not help.
    """

    needs = "service"

    def __init__(
        self,
        message: str,
        *,
        hint: str = "",
        after: float | None = None,
        until: datetime | None = None,
    ) -> None:
        super().__init__(message, hint=hint, until=until)
        self.after = after


class Challenged(ActionNeeded):
    """The service wants a person (captcha, consent, challenge page) or turns crawlers away. Never a
    fact about an item.
    """


class Untrusted(ActionNeeded):
    """The certificate of a service is not trusted by this machine."""

    needs = "certificate"


class Unreachable(ActionNeeded):
    """No connection to the service, or it answers with server errors only."""

    needs = "connection"


class DiskFull(ActionNeeded):
    """No room to write; nothing half-written was left behind."""

    needs = "disk space"


class LimitReached(Stopped):
    """The --limit of new items was reached."""


class Interrupted(Stopped):
    """SIGINT or SIGTERM: the item in hand was finished."""


TURNED_AWAY = (Blocked, Challenged)  # by the service, whatever the item was
GLOBAL_STOPS = (DiskFull, Interrupted)  # they concern every part of a command


def severity(error: KbError) -> tuple[bool, bool, bool]:
    """Sorts errors that ended parts of one command: what failed, what waits for somebody, what
    passes with time, `--limit`. The first decides the exit code.
    """
    return (
        isinstance(error, Stopped),
        not isinstance(error, ActionNeeded),
        isinstance(error, LimitReached),
    )


class ItemError(KbError):
    """About one item. Caught by the stage, never by the command line."""


class ItemFinal(ItemError):
    """A fact about the item: recorded and not tried again.

    `reason` is a short code such as "not_found", `value` what was seen.
    """

    def __init__(self, reason: str, value: str | None = None) -> None:
        super().__init__(reason if value is None else f"{reason}: {value}")
        self.reason = reason
        self.value = value


class Retryable(ItemError):
    """May go well next time. `after` is the service's own wish in seconds (Retry-After).

    `unreachable`: there was no connection. `throttled`: the service asked us to slow down; when
    that does not end, it blocks us, which is not a fact about an item. `status`: the HTTP status
    that said so, if one did.
    """

    def __init__(
        self,
        reason: str,
        *,
        after: float | None = None,
        unreachable: bool = False,
        throttled: bool = False,
        status: int | None = None,
    ) -> None:
        super().__init__(reason)
        self.status = status
        self.reason = reason
        self.after = after
        self.unreachable = unreachable
        self.throttled = throttled


class Postponed(ItemError):
    """May go well later in this run: the item goes to the end of the queue and counts as not asked
    for. The connector decides when it has failed.
    """
