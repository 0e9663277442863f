"""What a new source gets from the frame without writing it: resume, limit, wait,
failures, blocks.
"""

from __future__ import annotations

import signal
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import pytest

from kb.core import clock
from kb.core.context import Run
from kb.core.errors import Blocked, LimitReached, OtherService, Unreachable, WriterLocked
from kb.core.profile import load_profile
from kb.core.settings import load_settings
from kb.core.verdict import Summary
from kb.crawl.job import work
from kb.crawl.loop import Loop
from kb.crawl.session import Session, open_session
from kb.crawl.source import Phase
from kb.store import rawlog
from kb.store.frontier import Item
from tests import forked
from tests.crawl.feed import NOTES, PAGES, Feed
from tests.crawl.service import Service, serving

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture
def service() -> Iterator[Service]:
    """Ten notes on four pages."""
    with serving(10) as running:
        yield running


@pytest.fixture
def run(tmp_path: Path) -> Run:
    """A fresh data root."""
    settings = load_settings(dotenv=False, kb_data=tmp_path)
    return Run(settings=settings, profile=load_profile("minecraft"), root=tmp_path)


def summary(session: Session, loop: Loop) -> Summary:
    """The figures of a run."""
    return Summary(
        notes=loop.answered["notes"],
        failed=session.frontier.counts("notes").get("error", 0),
        left=session.frontier.waiting("notes", "pages"),
    )


def crawl(run: Run, service: Service) -> Summary:
    """One run of the feed's crawl."""
    return work(run, Feed(run.settings, service.root), summary)


def texts(root: Path) -> list[str]:
    """The notes in the raw log, in the order in which they came."""
    return [each.response["text"] for each in rawlog.read(root, "feed", "notes")]


def test_everything_once_and_a_second_run_asks_nothing(run: Run, service: Service) -> None:
    assert crawl(run, service) == {"notes": 10, "failed": 0, "left": 0}
    assert set(service.asked.values()) == {1}
    asked = service.asked.total()
    assert crawl(run, service) == {"notes": 0, "failed": 0, "left": 0}
    assert service.asked.total() == asked == 14


def test_limit_lists_no_more_than_it_needs_and_goes_on(run: Run, service: Service) -> None:
    with pytest.raises(LimitReached) as stop:
        crawl(replace(run, limit=4), service)
    assert stop.value.summary == {"notes": 4, "failed": 0, "left": 3}
    assert "/notes?page=3" not in service.asked
    assert crawl(run, service)["notes"] == 6
    assert set(service.asked.values()) == {1}
    # A limit that everything fits into is no stop.
    assert crawl(replace(run, limit=4), service)["left"] == 0


def test_what_fails_is_tried_by_the_next_run_and_a_fact_is_not(run: Run, service: Service) -> None:
    faults = {"/notes/n002": (500, {}), "/notes/n005": (404, {})}
    service.fault = faults.get
    assert crawl(run, service) == {"notes": 10, "failed": 1, "left": 0}
    service.fault = lambda path: None
    before = service.asked["/notes/n005"]
    assert crawl(run, service) == {"notes": 1, "failed": 0, "left": 0}
    assert service.asked["/notes/n005"] == before
    assert len(texts(run.root)) == 9


def test_a_service_that_is_down_stops_the_run_soon(run: Run, service: Service) -> None:
    service.fault = lambda path: (503, {}) if path.startswith("/notes/") else None
    with pytest.raises(Unreachable):
        crawl(run, service)
    assert service.asked.total() == 4  # a page and three notes
    service.fault = lambda path: None
    assert crawl(run, service)["notes"] == 10


def test_a_service_that_fails_for_the_last_items_is_down_too(run: Run) -> None:
    with serving(3) as service:
        service.fault = lambda path: (503, {}) if path.startswith("/notes/") else None
        with pytest.raises(Unreachable) as stop:
            crawl(run, service)
    assert stop.value.summary == {"notes": 3, "failed": 3, "left": 0}


def test_what_is_left_out_takes_nothing_of_the_limit(run: Run, service: Service) -> None:
    class Early(Feed):
        phases = (replace(NOTES, seeks=True), PAGES)

        def leave_out(self, phase: Phase, item: Item) -> str | None:
            return "late" if item.key >= "n004" else None

    early = Early(run.settings, service.root)
    assert work(replace(run, limit=4), early, summary) == {"notes": 4, "failed": 0, "left": 0}


def test_after_a_block_one_request_finds_out(run: Run, service: Service) -> None:
    service.fault = lambda path: (403, {}) if path == "/notes/n001" else None
    for _ in range(2):
        with pytest.raises(Blocked):
            crawl(run, service)
    assert service.asked["/notes/n001"] == 2
    service.fault = lambda path: None
    assert crawl(run, service)["notes"] == 9


def test_wait_sleeps_through_a_block(
    run: Run, service: Service, monkeypatch: pytest.MonkeyPatch
) -> None:
    slept: list[object] = []

    def wake_up(moment: object) -> None:
        slept.append(moment)
        service.fault = lambda path: None

    monkeypatch.setattr(clock, "sleep_until", wake_up)
    service.fault = lambda path: (403, {}) if path == "/notes/n001" else None
    assert crawl(replace(run, wait=True), service)["notes"] == 10
    assert len(slept) == 1


def test_a_lane_waits_for_one_that_sleeps(
    run: Run, service: Service, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its work comes from there: with --wait nothing is left behind when the block is over."""
    blocked = "/notes?page=2"
    service.fault = lambda path: (403, {}) if path == blocked else None

    def wake_up(moment: object) -> None:
        wait_until(lambda: "notes" not in "".join(each.name for each in threading.enumerate()))
        service.fault = lambda path: None

    monkeypatch.setattr(clock, "sleep_until", wake_up)
    feed = Feed(run.settings, service.root)
    feed.phases = (PAGES, replace(NOTES, lane="notes"))
    done = work(replace(run, wait=True), feed, summary)
    assert done == {"notes": 10, "failed": 0, "left": 0}


def wait_until(what: Callable[[], bool], seconds: float = 1.0) -> None:
    """Until it is so; no longer than some time, as it need not come true."""
    end = time.monotonic() + seconds
    while not what() and time.monotonic() < end:
        time.sleep(0.01)


def test_one_writer_and_one_feed_a_root(run: Run, service: Service) -> None:
    crawl(run, service)
    with (
        open_session(run, Feed(run.settings, service.root)),
        pytest.raises(WriterLocked, match="pid"),
    ):
        crawl(run, service)
    with pytest.raises(OtherService):
        work(run, Feed(run.settings, "http://elsewhere.example"), summary)


SCRIPT = """
import sys
from pathlib import Path
from kb.core.context import Run
from kb.core.profile import load_profile
from kb.core.settings import load_settings
from tests.crawl.test_frame import Feed, summary, work
root = Path(sys.argv[1])
run = Run(load_settings(dotenv=False, kb_data=root), load_profile("minecraft"), root)
work(run, Feed(run.settings, sys.argv[2]), summary)
"""


@pytest.mark.parametrize("number", [1, 2, 5, 9, 13])
def test_killed_at_any_request_it_loses_and_repeats_nothing(
    run: Run, service: Service, number: int
) -> None:
    children: list[forked.Started] = []

    def kill(path: str) -> None:
        if service.asked.total() == number:
            children[0].send_signal(signal.SIGKILL)

    service.fault = kill
    children.append(forked.program(SCRIPT, run.root, service.root, cwd=ROOT))
    assert children[0].wait(timeout=60) == -signal.SIGKILL
    service.fault = lambda path: None
    crawl(run, service)
    assert sorted(texts(run.root)) == [f"the text of {key}" for key in service.ids]
    assert service.asked.total() <= 15  # but for the one in flight, nothing was asked twice
