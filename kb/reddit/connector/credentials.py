"""What asking Reddit needs, and what to do without it: for most people a key is out of reach.

Since November 2025 Reddit gives keys only to apps that it has approved, since May 2026 it answers
nobody without one, and keys of before were revoked in waves from June 2026 on.
"""

from __future__ import annotations

from kb.core.context import Run
from kb.core.errors import CredentialRefused, MissingCredential
from kb.core.settings import REDDIT

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
