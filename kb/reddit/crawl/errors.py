"""What follows from a response of Reddit that does not answer the request.

the app's credentials are refused                       CredentialRefused
a page or a subreddit is gone, shut or barred           ItemFinal, FatalError for the subreddit
what guards Reddit turns us away                        Challenged
anything else about one post                            Retryable
anything else about us                                  FatalError
"""

from typing import Any

import prawcore.exceptions as wrong

from kb.core.config.settings import REDDIT
from kb.core.context import Run
from kb.core.errors import (
    Challenged,
    CredentialRefused,
    FatalError,
    ItemFinal,
    KbError,
    MissingCredential,
    Retryable,
)
from kb.net.session import refusal
from kb.schema.coerce import inner

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
        return Retryable(f"an answer at {path} is truncated or not JSON")
    if isinstance(error, wrong.Redirect):
        return ItemFinal("redirect", error.path)
    if isinstance(error, wrong.ResponseException):
        return _of_status(error.response, path)
    return error


def too_deep(path: str) -> Retryable:
    """An answer whose nesting ends Python's stack."""
    return Retryable(f"an answer nested too deeply to be read at {path}")


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
        return Challenged(
            "Reddit's network protection rejects requests (HTTP 403 with a page)",
            hint="run the same command from a network that Reddit accepts",
        )
    if token:
        if status in (400, 401, 403):
            return refused(f"credentials (HTTP {status})")
        return FatalError(f"Reddit answers HTTP {status} at {path}")
    if status in FACTS:
        return ItemFinal(FACTS[status], path)
    # About one post, whatever the status means; but a 400 to ids that Reddit gave is about us.
    if path.startswith("comments/") or (path.startswith("api/morechildren") and status != 400):
        return Retryable(f"HTTP {status} at {path}")
    return FatalError(f"Reddit answers HTTP {status} at {path}")


DUMPS = "archive dumps need no key: `kb reddit import FILE…`"
APPROVAL = (
    "since November 2025 a key needs Reddit's approval of the app under its Responsible Builder"
    " Policy"
)


def require(run: Run, *others: str, without: str = DUMPS) -> None:
    """Raise MissingCredential for all that is not set, of the `others` too; the hint begins with
    the way `without` a key.
    """
    try:
        run.settings.require(*others, *REDDIT)
    except MissingCredential as error:
        hints = [without, error.hint]
        if run.settings.reddit_client_id is None:
            hints.append(APPROVAL)
        error.hint = "; ".join(filter(None, hints))
        raise


def refused(what: str) -> CredentialRefused:
    """The app as a whole is refused, whatever was asked for."""
    return CredentialRefused(
        f"Reddit refused the app's {what}: the key is wrong, or Reddit has revoked it",
        hint=f"check REDDIT_CLIENT_ID and REDDIT_CLIENT_SECRET; {APPROVAL}; {DUMPS}",
    )


_LISTINGS = frozenset({"new", "top", "controversial", "hot", "rising", "search"})


def problem(path: str, answer: Any) -> str:
    """What is wrong with the answer to a request of `path`; empty when it holds what was
    asked for.
    """
    if not isinstance(answer, (dict, list)) or not answer:
        return "an empty answer"
    if isinstance(answer, dict):
        errors = answer["json"].get("errors") if isinstance(answer.get("json"), dict) else None
        if errors:
            first = errors[0] if isinstance(errors, list) else errors
            return f"error {first[0] if isinstance(first, list) and first else first}"
        if "error" in answer and "data" not in answer:
            return f"error {answer['error']}"
    return (
        ""
        if _expected(path.strip("/").split("/"), answer)
        else "an answer of another form than was asked for"
    )


def _expected(parts: list[str], answer: Any) -> bool:
    if parts[0] == "comments":
        return (
            isinstance(answer, list)
            and len(answer) == 2
            and all(map(_is_listing, answer))
            and any(child["kind"] == "t3" for child in answer[0]["data"]["children"])
        )
    if parts == ["api", "morechildren"]:
        return _are_things(inner(answer, "json", "data", "things"))
    if parts == ["api", "info"] or (parts[0] == "r" and len(parts) == 3 and parts[2] in _LISTINGS):
        return _is_listing(answer)
    return True


def _is_listing(value: Any) -> bool:
    return (
        isinstance(value, dict)
        and value.get("kind") == "Listing"
        and _are_things(inner(value, "data", "children"))
    )


def _are_things(value: Any) -> bool:
    return isinstance(value, list) and all(map(_is_thing, value))


def _is_thing(value: Any) -> bool:
    """A post or comment with its id, or a stub with what it stands for."""
    kind, key, children = (
        inner(value, "kind"),
        inner(value, "data", "id"),
        inner(value, "data", "children"),
    )
    return (
        isinstance(children, list)
        if kind == "more"
        else isinstance(kind, str) and isinstance(key, str) and key != ""
    )
