"""Search: answers as `kb search` gives them, page by page."""

from __future__ import annotations

import shlex
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any
from urllib.parse import urlencode

from kb.core.config.profile import Profile
from kb.core.errors import KbError, UsageError
from kb.core.search_hit import SearchHit
from kb.core.sources import KINDS, SOURCES
from kb.explore.tables import page_number
from kb.mcp.search_tool import ref
from kb.score.clip_search import ClipSearch, has_clips
from kb.search.answers import MARK, NotIndexed, search_as_meant
from kb.search.coverage import coverage
from kb.search.ranking import Only, day_given

ON_A_PAGE = 20  # answers
_LAST = 50  # pages: each is ranked with all before it
_FIELDS = ("words", "source", "kind", "entity", "since", "until", "least", "clips")


@dataclass(frozen=True)
class SearchPage:
    """What was asked, by the name of its field, and the answers, best first; or why there are none:
    `problem`, and a `hint` what to do. `instead`: these are those to the suggestion. `more`: there
    is another page. `covers`: what is searched. An answer of `hits` has the address of its
    surroundings, and its snippet in pieces of which every second one is marked. `has_clips`: the
    pictures of clips can be searched.
    """

    asked: dict[str, str]
    hits: list[tuple[SearchHit, str, list[str]]]
    suggestion: str
    instead: bool = False
    problem: str = ""
    hint: str = ""
    page: int = 1
    more: bool = False
    covers: str = ""
    sources: tuple[str, ...] = tuple(SOURCES)
    kinds: tuple[str, ...] = KINDS
    has_clips: bool = False

    @property
    def suggested(self) -> str:
        return self._address(words=self.suggestion)

    def address(self, page: int) -> str:
        """The address of another page of the same answers."""
        return self._address(page=page)

    def _address(self, **changes: Any) -> str:
        given = {name: value for name, value in (self.asked | changes).items() if value}
        return f"/search?{urlencode(given)}"


def read(root: Path, profile: Profile, query: Mapping[str, str]) -> SearchPage:
    """The answers to an address; none without words, and none where the index is missing or out of
    date: it is not built here, as that could keep other commands from writing. Raises UsageError,
    DamagedData.
    """
    if query.get("clips") and query.get("words", "").strip():
        return _of_clips(root, profile, query)
    return replace(_of_texts(root, query), has_clips=has_clips(root))


def _of_clips(root: Path, profile: Profile, query: Mapping[str, str]) -> SearchPage:
    """The clips whose pictures are most like the words, one of each video."""
    asked, number = _asked(query), page_number(query, _LAST)
    search = ClipSearch(root, profile)
    if not search.is_current:
        command = f"kb search --clips {shlex.quote(asked['words'])}"
        problem = "the index of clips is missing or out of date"
        return SearchPage(asked, [], "", problem=problem, hint=f"run `{command}`", has_clips=True)
    hits = search.hits(asked["words"], number * ON_A_PAGE + 1)
    shown = [_shown(hit, hit.keyword) for hit in hits[(number - 1) * ON_A_PAGE :][:ON_A_PAGE]]
    more = len(hits) > number * ON_A_PAGE and number < _LAST
    cut = search.cut_tokens(asked["words"])
    covers = f"Pictures of clips, by {search.model}; the score is the cosine of clip and words."
    covers += f" The words are too long for it: their last {cut} tokens are left out." * bool(cut)
    return SearchPage(asked, shown, "", page=number, more=more, covers=covers, has_clips=True)


def _of_texts(root: Path, query: Mapping[str, str]) -> SearchPage:
    asked = _asked(query)
    if not asked["words"]:
        return SearchPage(asked, [], "", covers=str(coverage(root)))
    if asked["source"] not in ("", *SOURCES):
        raise UsageError(f"unknown source {asked['source']!r}")
    if asked["kind"] not in ("", *KINDS):
        raise UsageError(f"unknown kind {asked['kind']!r}")
    try:
        least = float(asked["least"] or 0)
    except ValueError:
        raise UsageError(f"the minimum score is {asked['least']!r}, not a number") from None
    number = page_number(query, _LAST)
    only = Only(
        kinds=(asked["kind"],) if asked["kind"] else (),
        since=day_given("since", asked["since"]),
        until=day_given("until", asked["until"]),
        least=least,
        limit=number * ON_A_PAGE + 1,
    )
    sources = [asked["source"]] if asked["source"] else []
    try:
        hits, meant, instead = search_as_meant(
            root, asked["words"], sources=sources, only=only, entity=asked["entity"]
        )
    except NotIndexed as error:
        return without_answers(query, error)
    words = meant if instead else asked["words"]
    shown = [_shown(hit, words) for hit in hits[(number - 1) * ON_A_PAGE :][:ON_A_PAGE]]
    more = len(hits) > number * ON_A_PAGE and number < _LAST
    covers = str(coverage(root))
    return SearchPage(asked, shown, meant, instead, page=number, more=more, covers=covers)


def without_answers(query: Mapping[str, str], error: KbError) -> SearchPage:
    """The page of a question that has no answers for this reason."""
    return SearchPage(_asked(query), [], "", problem=str(error), hint=error.hint)


def _asked(query: Mapping[str, str]) -> dict[str, str]:
    return {name: query.get(name, "").strip() for name in _FIELDS}


def _shown(hit: SearchHit, words: str) -> tuple[SearchHit, str, list[str]]:
    pieces = hit.snippet.split(MARK)
    if len(pieces) % 2 == 0:  # the text has such a mark of its own
        pieces = [hit.snippet]
    return hit, f"/document?{urlencode({'ref': ref(hit), 'words': words})}#here", pieces
