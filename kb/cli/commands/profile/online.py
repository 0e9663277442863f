"""`kb profile check --online`: asks each service one question, with the crawls' own clients.

A search for channels, the wiki's siteinfo with a few pages to try the selectors on, the subreddit.
Nothing is stored, and no question is retried.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from typing import TYPE_CHECKING, NamedTuple

from kb.core.config.profile.check_finding import (
    ERROR,
    REFUSED,
    UNREACHABLE,
    WARNING,
    WRONG,
    Finding,
    OnlineAnswer,
    QuestionCost,
)
from kb.core.errors import (
    CredentialRefused,
    Interrupted,
    KbError,
    MissingCredential,
    Retryable,
    SettingError,
    Stopped,
)
from kb.core.sources import SOURCES

if TYPE_CHECKING:
    from kb.core.context import Run


class ServiceCheck(NamedTuple):
    """A service's answer: the finding, its cost, and the exit code that follows.

    `pages` are some of the wiki's pages as HTML, to try the selectors on.
    """

    source: str
    finding: Finding
    requests: int = 0
    units: int = 0
    code: int = 0
    pages: tuple[str, ...] = ()


def ask(run: Run) -> Iterator[ServiceCheck]:
    """One answer for each source of the profile. Raises Interrupted only."""
    for source, each in SOURCES.items():
        if getattr(run.profile, source) is None:
            continue
        cost = QuestionCost()
        answer = _tried(partial(each.question, run, cost), source)
        if answer is None:
            continue
        level, key, what, fix, code = answer
        finding = Finding(level, f"online: {source}", 0, key, f"{what} ({cost})", fix)
        yield ServiceCheck(source, finding, cost.requests, cost.units, code, tuple(cost.pages))


def _tried(question: Callable[[], OnlineAnswer | None], source: str) -> OnlineAnswer | None:
    """The answer, or what an error means for the profile."""
    try:
        return question()
    except (MissingCredential, SettingError) as error:
        return OnlineAnswer(WARNING, "", f"not asked: {error}", error.hint)
    except (Retryable, Stopped) as error:
        if isinstance(error, Interrupted):
            raise
        hint = error.hint or "run the same command later"
        return OnlineAnswer(WARNING, "", f"no answer: {error}", hint, UNREACHABLE)
    except KbError as error:
        code = REFUSED if isinstance(error, CredentialRefused) else WRONG
        return OnlineAnswer(ERROR, "", str(error), error.hint, code)
