"""What is known about a profile and its keyword lists without asking anybody.

examine(path)          every finding, for `kb profile check`
refuse(profile)        before a crawl, a filter or pairs: an error ends the command, nothing is sent
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from kb.core.context import Run
    from kb.core.profile import Profile
    from kb.core.profile.check import Checked
    from kb.core.profile.finding import Finding


def examine(path: Path, *, publishing: bool = True) -> Checked:
    """The profile's file and its keyword lists, worst findings first. Raises nothing of its own."""
    from kb.core.profile.check import check_file
    from kb.core.profile.finding import worst_first
    from kb.pairs.keyword_list import check_lists

    checked = check_file(path, publishing=publishing)
    section = checked.profile.pairs if checked.profile else None
    listed = check_lists(path.parent, checked.lists, section)
    return checked._replace(findings=worst_first([*checked.findings, *listed]))


def refuse(profile: Profile) -> None:
    """Raises ProfileError where the profile or a list of its own has errors; warnings pass, and so
    does what only a published release needs.
    """
    from kb.core.errors import ProfileError
    from kb.core.profile.finding import ERROR

    errors = [one for one in examine(profile.path, publishing=False).findings if one.level == ERROR]
    if not errors:
        return
    more = f" (and {len(errors) - 1} more)" if len(errors) > 1 else ""
    name = profile.path.parent.name if profile.is_shipped else str(profile.path)
    raise ProfileError(
        f"profile {profile.path.parent}/{errors[0].sentence()}{more}",
        hint=f"mend it; `kb profile check {name}` lists everything",
    )


def contact_of(run: Run) -> list[Finding]:
    """A KB_CONTACT that nobody reads, where public services would be sent it."""
    from kb.core.addresses import is_loopback
    from kb.core.contact import is_placeholder
    from kb.core.profile.finding import ERROR, Finding

    settings = run.settings
    roots = (settings.kb_wiki_url, settings.kb_reddit_endpoint, settings.kb_youtube_web)
    if any(root and is_loopback(root) for root in roots):
        return []  # the sandbox, which sets one of its own
    if not settings.kb_contact or not is_placeholder(settings.kb_contact):
        return []
    what = f"KB_CONTACT is the placeholder {settings.kb_contact}"
    mend = "write an address that you read: wikis and Reddit see it in the User-Agent"
    return [Finding(ERROR, ".env", 0, "KB_CONTACT", what, mend)]
