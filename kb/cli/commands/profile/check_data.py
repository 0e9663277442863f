"""Findings of `kb profile check` from a data root: keyword matches, the wiki's selectors."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import zstandard

from kb.core.config.profile.check_finding import ERROR, NOTE, WARNING, Finding
from kb.core.config.profile.wiki import Markup
from kb.core.errors import FatalError, MissingExtra, Retryable
from kb.pairs.keyword_hits import keyword_lines
from kb.store.layout import Layout
from kb.wiki.crawl.online import SelectorMatches, count_matches

if TYPE_CHECKING:
    from kb.core.config.profile import Profile
    from kb.core.context import Run

_UNUSED = 10  # keywords without a match that are named
_EXAMPLES = 3
PAGES = 20  # captured pages that the selectors are tried on
_SELECTORS = "wiki selectors"
_ROOT = "wiki.markup.root"


def keyword_hits(run: Run) -> tuple[list[dict[str, Any]], list[Finding]]:
    """Matches of each keyword in clean transcripts, most first, and findings about them."""
    if run.profile.pairs is None:
        return [], []
    try:
        lines = list(keyword_lines(run, _EXAMPLES, rare=True))
    except (FatalError, MissingExtra) as error:
        return [], [Finding(NOTE, "keywords", 0, "", f"not tried: {error}", error.hint)]
    rows = [line._asdict() for line in lines]
    unused = [line.keyword for line in lines if not line.matches]
    if not unused:
        return rows, []
    names = ", ".join(unused[:_UNUSED]) + (" …" if len(unused) > _UNUSED else "")
    what = f"{len(unused):,} of {len(lines):,} match nothing in {run.root}: {names}"
    return rows, [Finding(NOTE, "keywords", 0, "", what, "add forms that people say instead")]


def captured_pages(root: Path) -> list[str]:
    """The HTML of some captured pages, spread evenly over all; unreadable ones are left out."""
    paths = sorted(Layout(root).captures.glob("*/*/page.html.zst"))
    pages = []
    for path in paths[:: max(1, -(-len(paths) // PAGES))]:
        try:
            data = zstandard.ZstdDecompressor().decompressobj().decompress(path.read_bytes())
        except (OSError, zstandard.ZstdError):
            continue
        pages.append(data.decode("utf-8", "replace"))
    return pages


def selector_findings(profile: Profile, pages: list[str]) -> list[Finding]:
    """Invalid selectors, and selectors set by the profile itself that match nothing."""
    if profile.wiki is None:
        return []
    markup = profile.wiki.markup
    own = {
        f"wiki.markup.{name}"
        for name in markup.model_fields_set
        if getattr(markup, name) != getattr(Markup(), name)
    }
    try:
        counts = count_matches(markup, pages)
    except (MissingExtra, Retryable) as error:
        hint = error.hint if isinstance(error, MissingExtra) else ""
        return [Finding(NOTE, _SELECTORS, 0, "", f"not tried: {error}", hint)]
    fix = "write a CSS selector, such as .infobox"
    invalid = [
        Finding(ERROR, _SELECTORS, 0, one.key, f"'{one.key}' is not a CSS selector", fix)
        for one in counts
        if one.matches is None
    ]
    return [*invalid, *_unmatched(counts, own, len(pages))]


def _unmatched(counts: list[SelectorMatches], own: set[str], pages: int) -> list[Finding]:
    keys = [one.key for one in counts if one.matches == 0 and one.key in {_ROOT, *own}]
    findings = []
    if _ROOT in keys:
        keys.remove(_ROOT)
        what = f"'{_ROOT}' matches nothing in {pages} pages, so whole pages are read"
        fix = "name the element that holds a page's text, such as .mw-parser-output"
        findings.append(Finding(WARNING, _SELECTORS, 0, _ROOT, what, fix))
    if keys:
        what = f"no match in {pages} pages: {', '.join(keys)}"
        fix = "compare them with the classes in the wiki's pages"
        findings.append(Finding(WARNING, _SELECTORS, 0, keys[0], what, fix))
    return findings
