"""`kb profile keywords`: the wiki's pages as rows of a keyword list. Asks nobody."""

from __future__ import annotations

from typing import TYPE_CHECKING

from kb.core.errors import SettingError
from kb.pairs import keywords
from kb.pairs.keyword_proposal import PageNames, Proposal, propose
from kb.store import rawlog
from kb.wiki.parse.page_names import pages
from kb.wiki.spec import SPEC

if TYPE_CHECKING:
    from kb.core.context import Run


def proposed(run: Run) -> Proposal:
    """What the crawled wiki of a data root proposes beside the profile's own list.

    Raises SettingError without a crawled wiki, ProfileError for a list that can't be read.
    """
    if not rawlog.segments(run.root, SPEC.name, "pages"):
        raise SettingError(
            f"no wiki was crawled into {run.root}",
            hint="run `kb wiki crawl` first, or name its data root with --data",
        )
    section = run.profile.pairs
    listed = bool(section and (section.keyword_files or section.include))
    taken = keywords.load(run.profile).phrases if listed else ()
    titles = [
        PageNames(
            page.title.removeprefix(f"{page.prefix}:"),
            [title.removeprefix(f"{page.prefix}:") for title in page.redirects],
            page.categories,
        )
        for page in pages(run.root)
    ]
    return propose(titles, taken)
