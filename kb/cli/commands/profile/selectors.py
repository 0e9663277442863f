"""`kb profile check`: what the wiki's selectors match in pages that were captured, or read now."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import zstandard

from kb.core.errors import MissingExtra, Retryable
from kb.core.profile.finding import ERROR, NOTE, WARNING, Finding
from kb.core.profile.wiki import Markup
from kb.store.layout import Layout
from kb.wiki.browser.selectors import SelectorMatches, count_matches

if TYPE_CHECKING:
    from kb.core.profile import Profile

PAGES = 20  # captured pages that are looked at
_FILE = "wiki selectors"
_ROOT = "wiki.markup.root"


def captured_pages(root: Path) -> list[str]:
    """The HTML of some pages of a data root, spread evenly over all. Those that can't be read are
    left out.
    """
    found = sorted(Layout(root).captures.glob("*/*/page.html.zst"))
    pages = []
    for path in found[:: max(1, -(-len(found) // PAGES))]:
        try:
            data = zstandard.ZstdDecompressor().decompressobj().decompress(path.read_bytes())
        except (OSError, zstandard.ZstdError):
            continue
        pages.append(data.decode("utf-8", "replace"))
    return pages


def findings_of(profile: Profile, pages: list[str]) -> list[Finding]:
    """Selectors that are none, and of those that the profile itself sets what matches nothing."""
    if profile.wiki is None:
        return []
    markup = profile.wiki.markup
    own = {
        f"wiki.markup.{name}"
        for name in markup.model_fields_set
        if getattr(markup, name) != getattr(Markup(), name)
    }
    try:
        counted = count_matches(markup, pages)
    except (MissingExtra, Retryable) as error:
        hint = error.hint if isinstance(error, MissingExtra) else ""
        return [Finding(NOTE, _FILE, 0, "", f"not tried: {error}", hint)]
    return [*_wrong(counted), *_unmatched(counted, own, len(pages))]


def _wrong(counted: list[SelectorMatches]) -> list[Finding]:
    mend = "write a CSS selector, such as .infobox"
    return [
        Finding(ERROR, _FILE, 0, one.key, f"'{one.key}' is not a CSS selector", mend)
        for one in counted
        if one.matches is None
    ]


def _unmatched(counted: list[SelectorMatches], own: set[str], pages: int) -> list[Finding]:
    keys = [one.key for one in counted if one.matches == 0 and one.key in {_ROOT, *own}]
    found = []
    if _ROOT in keys:
        said = f"'{_ROOT}' matches nothing in {pages} pages, so whole pages are read"
        mend = "name what holds a page's text, such as .mw-parser-output"
        found.append(Finding(WARNING, _FILE, 0, _ROOT, said, mend))
    rest = [key for key in keys if key != _ROOT]
    if rest:
        said = f"no match in {pages} pages: {', '.join(rest)}"
        mend = "compare them with the classes in the wiki's pages"
        found.append(Finding(WARNING, _FILE, 0, rest[0], said, mend))
    return found
