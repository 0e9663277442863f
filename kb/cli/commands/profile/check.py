"""Checks a profile and its keyword lists without asking any service.

examine(path)          every finding, for `kb profile check`
refuse(profile)        ends a crawl, a filter or pairs before anything is sent if there is an error
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from kb.core.config.addresses import is_loopback
from kb.core.config.profile.base import is_placeholder
from kb.core.config.profile.check import Checked, check_file
from kb.core.config.profile.check_finding import ERROR, Finding, worst_first
from kb.core.errors import ProfileError

if TYPE_CHECKING:
    from kb.core.config.profile import Profile
    from kb.core.context import Run


def examine(path: Path, *, publishing: bool = True) -> Checked:
    """Findings about the profile's file and its keyword lists, worst first."""
    from kb.pairs.keyword_list import check_lists

    checked = check_file(path, publishing=publishing)
    profile = checked.profile
    youtube = profile.youtube if profile else None
    listed = check_lists(
        path.parent,
        checked.lists,
        profile.pairs if profile else None,
        topic_known=youtube is None or bool(youtube.game_ids) or youtube.imported_topic == "known",
    )
    return checked._replace(findings=worst_first([*checked.findings, *listed]))


def refuse(profile: Profile) -> None:
    """Raise ProfileError for errors in the profile or its lists.

    Warnings pass, and so does what only a published release needs.
    """
    errors = [one for one in examine(profile.path, publishing=False).findings if one.level == ERROR]
    if not errors:
        return
    more = f" (and {len(errors) - 1} more)" if len(errors) > 1 else ""
    name = profile.path.parent.name if profile.is_shipped else str(profile.path)
    raise ProfileError(
        f"profile {profile.path.parent}/{errors[0].sentence()}{more}",
        hint=f"fix it; `kb profile check {name}` lists every problem",
    )


def contact_findings(run: Run) -> list[Finding]:
    """A KB_CONTACT that nobody reads, if public services would be sent it."""
    settings = run.settings
    roots = (settings.kb_wiki_url, settings.kb_reddit_endpoint, settings.kb_youtube_web)
    if any(root and is_loopback(root) for root in roots):
        return []  # the sandbox sets a contact of its own
    if not settings.kb_contact or not is_placeholder(settings.kb_contact):
        return []
    what = f"KB_CONTACT is the placeholder {settings.kb_contact}"
    fix = "set an address that you read: wikis and Reddit see it in the User-Agent"
    return [Finding(ERROR, ".env", 0, "KB_CONTACT", what, fix)]
