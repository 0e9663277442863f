"""What follows from an answer of Reddit that is no answer to what was asked.

the app's credentials are refused                       CredentialRefused
a page or a subreddit is gone, shut or barred           ItemFinal, FatalError for the subreddit
we are turned away, for long or by what guards Reddit   Blocked
anything else about one post                            Retryable
anything else about us                                  FatalError
"""

from __future__ import annotations

from typing import Any

import prawcore.exceptions as wrong

from kb.core.errors import Blocked, FatalError, ItemFinal, KbError, Retryable
from kb.net.session import refusal
from kb.reddit.connector.credentials import refused

FACTS = {403: "forbidden", 404: "not_found", 410: "gone", 451: "legal"}
STATUS = {reason: status for status, reason in FACTS.items()}
REDIRECT = 302  # the status of ItemFinal("redirect")

_NO_SUBREDDIT = {
    "forbidden": "is private or quarantined",
    "not_found": "does not exist or is banned",
    "redirect": "does not exist",
}


def consequence(error: wrong.PrawcoreException, path: str) -> Exception:
    """What follows from what PRAW's core raised for a request of `path`."""
    if isinstance(error, wrong.OAuthException):
        return refused(f"credentials ({error.error})")
    if isinstance(error, wrong.InvalidToken):
        return refused("token")
    if isinstance(error, wrong.RequestException):
        broken = error.original_exception
        if isinstance(broken, KbError):  # of the ledger, the pace or the door
            return broken
        return Retryable(f"{type(broken).__name__} at {path}", unreachable=True)
    if isinstance(error, wrong.BadJSON):
        return Retryable(f"an answer at {path} was cut off or is no JSON")
    if isinstance(error, wrong.Redirect):
        return ItemFinal("redirect", error.path)
    if isinstance(error, wrong.ResponseException):
        return _of_status(error.response, path)
    return error


def too_deep(path: str) -> Retryable:
    """An answer whose nesting ends Python's stack."""
    return Retryable(f"an answer nested too deep to be read at {path}")


def no_subreddit(name: str, fact: ItemFinal) -> FatalError:
    """A listing of the subreddit itself can't be had."""
    why = _NO_SUBREDDIT.get(fact.reason, f"can't be read ({fact.reason})")
    return FatalError(f"{name} {why}", hint="check [reddit] subreddit in the profile")


def _of_status(response: Any, path: str) -> KbError:
    """Of an answer that is no 200. Of the token's own requests none is a fact about an item."""
    status, token = response.status_code, "access_token" in (response.url or "")
    later = refusal(response, path)
    if later is not None:
        return later
    if status == 403 and b"<html" in response.content[:2_000].lower():
        # The API answers in JSON; a page comes from what guards it.
        return Blocked(
            "Reddit's network protection turns us away (HTTP 403 with a page)",
            hint="run the same command later, from a network that Reddit accepts",
        )
    if token:
        if status in (400, 401, 403):
            return refused(f"credentials (HTTP {status})")
        return FatalError(f"Reddit answers HTTP {status} at {path}")
    if status in FACTS:
        return ItemFinal(FACTS[status], path)
    if _about_one_post(path, status):
        return Retryable(f"HTTP {status} at {path}")
    return FatalError(f"Reddit answers HTTP {status} at {path}")


def _about_one_post(path: str, status: int) -> bool:
    """Whatever the status means; but a 400 to ids that Reddit itself gave is about us."""
    if path.startswith("comments/"):
        return True
    return path.startswith("api/morechildren") and status != 400
