"""`search`: ranked answers, each with its source, link and ref."""

import threading
from collections.abc import Sequence
from urllib.parse import parse_qs, urlsplit

from kb.core.context import Run
from kb.core.search_hit import SearchHit
from kb.core.sources import SOURCES
from kb.mcp.documents import SourceLocation, from_link
from kb.mcp.untrusted_text import AnswerPart, Fence, fit
from kb.search.answers import search_as_meant
from kb.search.build import ensure
from kb.search.coverage import coverage
from kb.search.ranking import Only

_BUILDING = threading.Lock()  # only one call builds an index


def run_search(
    run: Run, words: str, sources: Sequence[str], only: Only, size: int, entity: str = ""
) -> str:
    """The answers, best first, in at most `size` characters. Raises KbError.

    An index that is missing or out of date is built first.
    """
    chosen = [source for source in SOURCES if not sources or source in sources]
    with _BUILDING:
        ensure(run, chosen)
    answers, meant, instead = search_as_meant(
        run.root, words, sources=chosen, only=only, size=size, entity=entity
    )
    fence = Fence()
    known = coverage(run.root)
    if not answers:
        return f"No answers. Try other or fewer words, or fewer filters. {known}"
    count = "1 answer" if len(answers) == 1 else f"{len(answers)} answers"
    if instead:
        count = f"Nothing has these words; read as {meant!r}: {count}"
    head = f"{fence.note}\n{count}, best first; `read` with a ref returns the surroundings."
    head += f"\n{known}" * bool(known.lacking)
    parts = [_part(number, hit) for number, hit in enumerate(answers, 1)]
    return fit(fence, head, parts, _left_out, size)


def _left_out(count: int) -> str:
    what = "1 more answer was" if count == 1 else f"{count} more answers were"
    return f"{what} left out: raise max_chars, or lower limit."


def _part(number: int, hit: SearchHit) -> AnswerPart:
    licence = f"licence {hit.licence}" if hit.licence else "no licence given"
    parts = [f"{hit.source} {hit.kind}", hit.date, revision(hit.url), licence]
    facts = " · ".join(part for part in parts if part)
    where = " › ".join(part for part in (hit.title, hit.path) if part)
    return AnswerPart(
        f"{number}. {facts} · score {hit.score:.2f}\nlink: {hit.url}\nref: {ref(hit)}",
        f"{where}\n{hit.text}",
        f"{where}\n{hit.snippet}",
    )


def revision(url: str) -> str:
    """The revision in a link to a wiki."""
    number = parse_qs(urlsplit(url).query).get("oldid")
    return f"revision {number[0]}" if number else ""


def ref(hit: SearchHit) -> str:
    """The reference to an answer's place, for `read`."""
    known = from_link(hit.url)
    if known is None or known.source != hit.source:
        return SourceLocation(hit.source, hit.key).ref
    return known.ref if SOURCES[hit.source].hosts else known._replace(key=hit.key).ref
