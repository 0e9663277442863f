"""What a new source gets from the frame without writing it: resume, limit, wait,
failures, blocks.
"""

import signal
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import pytest

from kb.core import clock
from kb.core.context import Run
from kb.core.errors import (
    Blocked,
    LimitReached,
    NothingRead,
    Retryable,
    Unreachable,
)
from kb.core.summary import Summary
from kb.crawl.job import work
from kb.crawl.loop import Loop
from kb.crawl.session import CrawlSession
from kb.crawl.source import Answer, Phase
from kb.store.rawlog import rawlog
from kb.store.rawlog.rawlog import Envelope
from kb.store.state.frontier import Frontier, Item
from tests import processes
from tests.fourth.feed.connector import NOTES, PAGES, Feed
from tests.fourth.service import Service, serving

ROOT = Path(__file__).resolve().parents[2]


def summary(session: CrawlSession, loop: Loop) -> Summary:
    """The figures of a run."""
    return Summary(
        notes=loop.answered["notes"],
        failed=session.frontier.counts("notes").get("error", 0),
        left=session.frontier.waiting("notes", "pages"),
    )


def crawl(run: Run, service: Service) -> Summary:
    """One run of the feed's crawl."""
    return work(run, Feed(run, service.root), summary)


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
    assert service.asked.total() == 4  # a page and three notes; no other one is known yet
    service.fault = lambda path: None
    assert crawl(run, service)["notes"] == 10


def test_a_service_that_fails_for_the_last_items_is_down_too(run: Run) -> None:
    with serving(3) as service:
        service.fault = lambda path: (503, {}) if path.startswith("/notes/") else None
        with pytest.raises(Unreachable) as stop:
            crawl(run, service)
    assert stop.value.summary == {"notes": 3, "failed": 3, "left": 0}


HEAD, TAIL, SPREAD = range(50), range(450, 500), range(3, 500, 10)


@pytest.mark.parametrize("where", [HEAD, TAIL, SPREAD], ids=["first", "last", "spread"])
@pytest.mark.parametrize("status", [500, 200], ids=["HTTP 500", "no JSON"])
def test_fifty_items_that_always_fail_keep_no_other_from_being_read(
    run: Run, where: range, status: int
) -> None:
    with serving(500, page=100) as service:
        bad = {f"/notes/{service.ids[number]}" for number in where}
        service.fault = lambda path: (status, {"X-Body": "<"}) if path in bad else None
        assert crawl(run, service) == {"notes": 500, "failed": 50, "left": 0}
        assert len(texts(run.root)) == 450
        # Nor does the next run end before them: each is tried once more, and nothing else read.
        tried = {path: service.asked[path] for path in bad}
        assert crawl(run, service) == {"notes": 50, "failed": 50, "left": 0}
        assert all(service.asked[path] == tried[path] + 1 for path in bad)
        assert len(texts(run.root)) == 450


def test_what_failed_is_tried_again_after_all_others(run: Run, service: Service) -> None:
    bad = {"/notes/n000", "/notes/n004"}
    service.fault = lambda path: (500, {}) if path in bad else None
    with pytest.raises(LimitReached):
        crawl(replace(run, limit=6), service)
    service.fault = lambda path: None
    assert crawl(run, service) == {"notes": 6, "failed": 0, "left": 0}
    assert [text[-4:] for text in texts(run.root)][-3:] == ["n009", "n000", "n004"]


def test_a_service_that_goes_down_midway_stops_the_run(run: Run) -> None:
    with serving(40, page=40) as service:
        service.fault = lambda path: (503, {}) if service.asked.total() > 21 else None
        with pytest.raises(Unreachable) as stop:
            crawl(run, service)
        assert stop.value.summary == {"notes": 23, "failed": 3, "left": 17}
        assert service.asked.total() == 25  # three notes, and one that was answered before
        service.fault = lambda path: None
        assert crawl(run, service) == {"notes": 20, "failed": 0, "left": 0}


def test_of_a_service_that_is_down_what_failed_before_is_not_asked_for_without_end(
    run: Run,
) -> None:
    with serving(40, page=40) as service:
        bad = set(service.ids[10:])
        service.fault = lambda path: (503, {}) if path[-4:] in bad else None
        assert crawl(run, service)["failed"] == 30
        before = service.asked.total()
        service.fault = lambda path: (503, {})
        with pytest.raises(Unreachable):
            crawl(run, service)
        assert service.asked.total() == before + 4


def test_where_nothing_was_ever_answered_each_run_tries_others(run: Run) -> None:
    with serving(12, page=12) as service:
        service.fault = lambda path: (503, {}) if path.startswith("/notes/") else None
        for _ in range(5):
            with pytest.raises(Unreachable):
                crawl(run, service)
        assert {service.asked[f"/notes/{key}"] > 0 for key in service.ids} == {True}


@pytest.mark.parametrize("known", [True, False], ids=["answered before", "never answered"])
def test_a_run_without_one_answer_looks_whether_the_service_is_down(run: Run, known: bool) -> None:
    """However few items there are to fail."""
    with serving(2, page=2) as service:
        service.fault = lambda path: (500, {}) if path == "/notes/n001" else None
        if not known:
            service.fault = lambda path: (500, {})
            with pytest.raises(Unreachable):
                crawl(run, service)
            return
        assert crawl(run, service)["failed"] == 1
        assert crawl(run, service)["failed"] == 1
        service.fault = lambda path: (500, {})
        with pytest.raises(Unreachable):
            crawl(run, service)


class Batches(Feed):
    """The feed, notes asked for eight at a time: one bad note fails the whole request."""

    phases = (replace(NOTES, batch=8), PAGES)
    bad: frozenset[str] = frozenset()
    refused = 0

    def fetch(self, phase: Phase, items: list[Item]) -> Iterator[Answer]:
        if phase.kind == "pages":
            yield from super().fetch(PAGES, items)
            return
        if not self.bad.isdisjoint(item.key for item in items):
            self.refused += 1
            raise Retryable("a bad one among them")
        for item in items:
            yield from super().fetch(phase, [item])


@pytest.mark.parametrize(
    "bad", [["n000"], ["n007", "n008"], [f"n{n:03d}" for n in range(0, 100, 10)], ["n099"]]
)
def test_a_batch_that_fails_is_halved_until_only_the_bad_items_are_left(
    run: Run, bad: list[str]
) -> None:
    with serving(100, page=50) as service:
        feed = Batches(run, service.root)
        feed.bad = frozenset(bad)
        assert work(run, feed, summary) == {"notes": 100, "failed": len(bad), "left": 0}
        assert len(texts(run.root)) == 100 - len(bad)
        assert feed.refused <= 4 * len(bad)


def test_after_a_block_one_request_finds_out(run: Run, service: Service) -> None:
    service.fault = lambda path: (403, {}) if path == "/notes/n001" else None
    for _ in range(2):
        with pytest.raises(Blocked):
            crawl(run, service)
    assert service.asked["/notes/n001"] == 2
    # It came behind those that were known: what is always refused keeps no other from being read.
    assert service.asked["/notes/n002"] == 1
    service.fault = lambda path: None
    assert crawl(run, service)["notes"] == 8


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


def test_a_service_waits_for_one_that_sleeps(
    run: Run, service: Service, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its work comes from there: with --wait nothing is left behind when the block is over."""
    blocked = "/notes?page=2"
    service.fault = lambda path: (403, {}) if path == blocked else None

    def wake_up(moment: object) -> None:
        wait_until(lambda: "notes" not in "".join(each.name for each in threading.enumerate()))
        service.fault = lambda path: None

    monkeypatch.setattr(clock, "sleep_until", wake_up)
    feed = Feed(run, service.root)
    feed.phases = (PAGES, replace(NOTES, service="notes"))
    done = work(replace(run, wait=True), feed, summary)
    assert done == {"notes": 10, "failed": 0, "left": 0}


def wait_until(what: Callable[[], bool], seconds: float = 1.0) -> None:
    """Until it is so; no longer than some time, as it need not come true."""
    end = time.monotonic() + seconds
    while not what() and time.monotonic() < end:
        time.sleep(0.01)


SCRIPT = """
import sys
from pathlib import Path
from kb.core.context import Run
from kb.core.config.profile import load_profile
from kb.core.config.settings import load_settings
from tests.crawl.test_loop import Feed, summary, work
root = Path(sys.argv[1])
run = Run(load_settings(dotenv=False, kb_data=root), load_profile("minecraft"), root)
work(run, Feed(run, sys.argv[2]), summary)
"""


@pytest.mark.parametrize("number", [1, 2, 5, 9, 13])
def test_killed_at_any_request_it_loses_and_repeats_nothing(
    run: Run, service: Service, number: int
) -> None:
    children: list[processes.ForkedProcess] = []

    def kill(path: str) -> None:
        if service.asked.total() == number:
            children[0].send_signal(signal.SIGKILL)

    service.fault = kill
    children.append(processes.program(SCRIPT, run.root, service.root, cwd=ROOT))
    assert children[0].wait(timeout=60) == -signal.SIGKILL
    service.fault = lambda path: None
    crawl(run, service)
    assert sorted(texts(run.root)) == [f"the text of {key}" for key in service.ids]
    assert service.asked.total() <= 15  # but for the one in flight, nothing was asked twice


def test_a_run_in_which_every_item_fails_is_no_success(run: Run) -> None:
    """Answers came, so the service is up; but nothing could be done with any of them."""

    class Odd(Feed):
        def reduce(self, frontier: Frontier, kind: str, envelope: Envelope) -> None:
            super().reduce(frontier, kind, envelope)
            if kind == "notes":
                key = envelope.request.params["id"]
                frontier.error("notes", key, "blank" if key != "n003" else "torn")

    with serving(12, page=12) as service:
        for _ in range(2):  # nothing was ever read, so it is worth the same word again
            with pytest.raises(NothingRead) as error:
                work(run, Odd(run, service.root), summary)
            assert str(error.value) == (
                "none of 12 notes could be read; the most frequent reason is blank (11 of 12)"
            )
            assert error.value.summary == {"notes": 12, "failed": 12, "left": 0}
        assert crawl(run, service)["failed"] == 0
