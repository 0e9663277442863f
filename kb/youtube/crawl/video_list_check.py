"""`kb youtube check`: how much of a published list of videos is there, changed or gone, by year.

A list's own words are compared with the API's, 50 ids a unit: title and duration where the list
has them. Of the answers only the verdicts are kept while the check goes on, and counts afterwards:
what the API says of a video may not be stored for long without being read again.

    state/youtube-check/<list>/         a check that is not finished: its frontier and verdicts
    state/youtube-check/<list>.json     counts of one that is
"""

import hashlib
import math
import re
import shutil
from collections import Counter
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import msgspec

from kb.core import clock
from kb.core.config.profile.collecting import YouTubeSection
from kb.core.context import Run
from kb.core.summary import Summary
from kb.core.summary.plan import PlanPhase as Step
from kb.core.summary.plan import plan as make_plan
from kb.crawl.connector import Answer, Phase
from kb.crawl.job import work
from kb.crawl.loop import Loop
from kb.crawl.session import CrawlSession
from kb.schema.coerce import durations
from kb.schema.decode import holdable
from kb.store.atomic import write_bytes
from kb.store.layout import Layout
from kb.store.rawlog import rawlog
from kb.store.rawlog.rawlog import Envelope
from kb.store.state.frontier import Frontier, Item
from kb.youtube.crawl.connector import YouTubeConnector
from kb.youtube.crawl.fetch import API, PACK
from kb.youtube.crawl.ids import RULES
from kb.youtube.crawl.quota import GENERAL
from kb.youtube.parse.answers import requested

CHECKS = "checks"  # kind of the frontier and of the verdicts
THERE, CHANGED, GONE = "there", "changed", "gone"
UNKNOWN = "unknown"  # the year of what is gone, where the list does not say it
_READ = Phase(
    kind=CHECKS, unit="videos", name="check", batch=PACK, service=API, bucket=GENERAL, limited=True
)
_COMPARED = ("title", "duration_s", "duration", "published_at")
_YEAR = re.compile(r"(?:19|20)[0-9]{2}")


Listed = tuple[bytes | None, int | None, str | None]
"""Of a video in a list the digest of its title (lists are long), its duration in seconds and its
year, as far as the list has them."""


def check(run: Run, ids: Path) -> Summary:
    """Ask for every id of the list once; counts by year.

    A list that was checked before is not asked for again without `--again`. Raises SettingError
    and MissingCredential before anything is sent, Stopped (the same command goes on).
    """
    listed, _, bad_lines, _ = RULES.read_some(ids, run.progress.say)
    name = hashlib.sha256("\n".join(listed).encode()).hexdigest()[:16]
    place = Layout(run.root).state_folder("youtube-check") / name
    kept = place.with_suffix(".json")
    if kept.is_file() and not run.again:
        known = msgspec.json.decode(kept.read_bytes())
        run.progress.say(f"{ids}: checked at {known['checked_at']}; --again checks again")
        return _summary(known["by_year"], bad_lines, kept)
    if run.again and kept.is_file():
        kept.unlink()
        shutil.rmtree(place, ignore_errors=True)
    source = Check(run, listed, facts_of(ids))
    done = work(run, source, source.summary, place=place, phases=source.chosen)
    counts = _counts(place)
    numbers = {one: done[one] for one in ("requests", "units", "failed")}
    if done["failed"]:  # the next run asks for these again
        return Summary({**_summary(counts, bad_lines, place), **numbers})
    finished = {"checked_at": clock.stamp(), "by_year": counts}
    write_bytes(kept, msgspec.json.encode(finished))
    shutil.rmtree(place)
    return Summary({**_summary(counts, bad_lines, kept), **numbers})


def plan(run: Run, ids: Path) -> Summary:
    """What a check would cost. Sends and writes nothing."""
    listed = RULES.read_some(ids).keys
    calls = math.ceil(len(listed) / PACK)
    a_day = run.profile.section(YouTubeSection).units_per_day
    step = Step("videos", len(listed), calls, calls)
    return Summary(make_plan("youtube check", "youtube", [step], (), days=round(calls / a_day, 2)))


def lines(summary: Mapping[str, Any]) -> Iterator[str]:
    """The counts by year as a table."""
    names = (THERE, CHANGED, GONE)
    yield "year".ljust(8) + "".join(name.rjust(12) for name in ("listed", *names))
    for year, verdicts in summary["by_year"].items():
        numbers = [sum(verdicts.values()), *(verdicts.get(name, 0) for name in names)]
        yield year.ljust(8) + "".join(f"{n:,}".rjust(12) for n in numbers)


class Check(YouTubeConnector):
    """The ids of a list, each asked for once."""

    def __init__(self, run: Run, listed: list[str], facts_of: Mapping[str, Listed]) -> None:
        super().__init__(run)
        self.chosen = [_READ]
        self._listed, self._facts = listed, facts_of

    def discover(self, frontier: Frontier) -> None:
        frontier.add(CHECKS, self._listed)

    def fetch(self, phase: Phase, items: list[Item]) -> Iterator[Answer]:
        """A pack of ids; what is recorded are verdicts alone."""
        assert self._fetch is not None
        keys = [item.key for item in items]
        answer = self._fetch.api.videos(id=",".join(keys), part="snippet,contentDetails")
        shown = {str(one.get("id")): one for one in answer.get("items") or []}
        verdicts = {key: _verdict(shown.get(key), self._facts.get(key)) for key in keys}
        yield Answer(CHECKS, "videos.list", {"id": ",".join(keys)}, verdicts)
        n_missing = sum(verdict == GONE for verdict, _ in verdicts.values())
        self._count(crawled=len(keys), missing=n_missing)

    def reduce(self, frontier: Frontier, kind: str, envelope: Envelope) -> None:
        """These ids are answered."""
        keys = requested(envelope.request.params)
        frontier.add(CHECKS, keys)
        frontier.done(CHECKS, *keys)

    def summary(self, session: CrawlSession, loop: Loop) -> Summary:
        """What this run asked, and what is left."""
        asked = self.of_known("youtube check", session, CHECKS)
        return Summary(asked, left=session.frontier.waiting(CHECKS))


def _verdict(shown: Any, listed: Listed | None) -> tuple[str, str]:
    """(there, changed or gone, year of publication)."""
    digest, duration_s, listed_year = listed or (None, None, None)
    if shown is None:
        return GONE, listed_year or UNKNOWN
    snippet = shown.get("snippet") or {}
    match = _YEAR.match(str(snippet.get("publishedAt") or ""))
    year = match[0] if match else listed_year or UNKNOWN
    title = snippet.get("title")
    if digest is not None and isinstance(title, str) and _digest(title) != digest:
        return CHANGED, year
    length = durations([(shown.get("contentDetails") or {}).get("duration")])[0][0].as_py()
    if duration_s is not None and length is not None and length != duration_s:
        return CHANGED, year
    return THERE, year


def _counts(place: Path) -> dict[str, dict[str, int]]:
    """Verdicts by year, of each id the newest."""
    newest: dict[str, tuple[str, str]] = {}
    for envelope in rawlog.read(place, "youtube", CHECKS):
        newest |= {key: (str(value[0]), str(value[1])) for key, value in envelope.response.items()}
    years: dict[str, Counter[str]] = {}
    for verdict, year in newest.values():
        years.setdefault(year, Counter())[verdict] += 1
    return {year: dict(sorted(years[year].items())) for year in sorted(years)}


def _summary(by_year: Mapping[str, Mapping[str, int]], bad_lines: int, path: Path) -> Summary:
    total: Counter[str] = Counter()
    for verdicts in by_year.values():
        total.update(verdicts)
    return Summary(
        command="youtube check",
        source="youtube",
        counted="videos",
        crawled=total.total(),
        there=total[THERE],
        changed=total[CHANGED],
        gone=total[GONE],
        failed=0,
        requests=0,
        units=0,
        bad_lines=bad_lines,
        by_year=by_year,
        path=str(path),
    )


def facts_of(path: Path) -> dict[str, Listed]:
    """What a list says of its videos besides their ids: Parquet, CSV and JSON with such columns.

    Raises SettingError.
    """
    records: dict[str, Listed] = {}
    for entry in RULES.entries(path, _COMPARED):
        key, row = RULES.parse(entry), entry.record
        if key is not None and any(row.get(name) is not None for name in _COMPARED):
            title, length = row.get("title"), row.get("duration_s", row.get("duration"))
            year = _YEAR.match(str(row.get("published_at") or ""))
            records[key] = (
                _digest(title) if isinstance(title, str) else None,
                round(length) if isinstance(length, (int, float)) else None,
                year[0] if year else None,
            )
    return records


def _digest(title: str) -> bytes:
    return hashlib.blake2b(str(holdable(title)).strip().encode(), digest_size=8).digest()
