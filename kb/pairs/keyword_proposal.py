"""Proposes a keyword list from the page titles of a wiki, for a person to edit.

A page's title is the keyword, its redirects are further forms, its category the kind, and an
everyday word gets the rule `near`. What can't be matched, or is already in the list, is left out
and counted.
"""

import re
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field

from kb.core.config.section import is_everyday
from kb.pairs.keyword_list import COLUMNS, LONGEST, forms
from kb.pairs.matching import phrase
from kb.schema.wiki_page import PageNames

PAGE = "page"  # the kind of a page without a category
_WORDS = 5  # longer titles are rarely said in full
_HEAD = """\
# Proposed from the titles, redirects and categories of {wiki}, one page a line: strike what nobody
# says or what is not your domain's, fix the kinds, and put the rest into the profile's list.
"""


@dataclass
class Proposal:
    """`rows`: keyword, kind, rule, forms. `left` counts titles that were left out, by reason."""

    rows: list[tuple[str, str, str, str]] = field(default_factory=list)
    left: Counter[str] = field(default_factory=Counter)

    def text(self, wiki: str) -> str:
        """The list as a file."""
        lines = ["\t".join(row).rstrip("\t") for row in (COLUMNS, *self.rows)]
        return _HEAD.format(wiki=wiki) + "\n".join(lines) + "\n"


def propose(pages: Iterable[PageNames], taken: Iterable[str] = ()) -> Proposal:
    """Rows by kind and keyword. `taken` are folded phrases that the profile has or excludes."""
    ordered = sorted(pages, key=lambda page: page.title)
    kinds = _kinds(ordered)
    known = set(taken)
    proposal = Proposal()
    titles: dict[str, tuple[PageNames, str]] = {}
    for page in ordered:
        name = _plain(page.title)
        folded = phrase(name)
        why = _unfit(name, folded)
        if not why and folded in known:
            why = "already in the list"
        if not why and folded in titles:
            why = "another page has this name"
        if why:
            proposal.left[why] += 1
            continue
        titles[folded] = (page, name)
    # A form stands for one keyword: names first, then redirects in the order of the titles.
    known |= titles.keys()
    for folded, (page, name) in titles.items():
        more = []
        follow = forms(folded)
        for redirect in page.redirects:
            if "/" in redirect:  # a subpage's old address, no word for it
                continue
            form = " ".join(_plain(redirect).replace(",", " ").split())
            key = phrase(form)
            if not _unfit(form, key) and key not in known and key not in follow:
                known.add(key)
                more.append(form)
        rule = "near" if is_everyday(name) else ""
        proposal.rows.append((name, kinds.get(page.title, PAGE), rule, ", ".join(more)))
    proposal.rows.sort(key=lambda row: (row[1].casefold(), row[0].casefold()))
    return proposal


def _kinds(pages: Sequence[PageNames]) -> dict[str, str]:
    """Title → the largest of its categories that holds at most half of all pages."""
    sizes = Counter(category for page in pages for category in page.categories)
    most = max(1, len(pages) // 2)
    chosen = {}
    for page in pages:
        fit = [category for category in page.categories if sizes[category] <= most]
        if fit or page.categories:
            best = min(fit or page.categories, key=lambda category: (-sizes[category], category))
            chosen[page.title] = " ".join(best.split()).lower()
    return chosen


def _plain(title: str) -> str:
    """A title as people say it: without what stands in brackets behind it, the last subpage."""
    return re.sub(r"\s*\([^()]*\)$", "", title.rpartition("/")[2].replace("_", " ")).strip()


def _unfit(name: str, folded: str) -> str:
    """Why a title can't be a keyword."""
    if not re.search(r"[^\W\d_]", folded):
        return "no word"
    if len(folded) > LONGEST or len(folded.split()) > _WORDS:
        return "too long to be said"
    if "\t" in name or name.startswith("#") or ":" in name:
        return "no name of a thing"
    return "one letter" if len(folded) < 2 else ""
