"""What a new source gets from the frame without writing it: resume, limit, wait,
failures, blocks.
"""

import signal
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest

from kb.core.context import Run
from kb.core.errors import (
    LimitReached,
    NothingRead,
    Retryable,
    Unreachable,
)
from kb.crawl.connector import Answer, Phase
from kb.crawl.job import work
from kb.store.rawlog import rawlog
from kb.store.rawlog.rawlog import Envelope
from kb.store.state.frontier import Frontier, Item
from tests import processes
from tests.crawl.feed import NOTES, PAGES, FeedConnector
from tests.crawl.runs import crawl, summary
from tests.crawl.service import Service, serving


def texts(root: Path) -> list[str]:
    """The notes in the raw log, in the order in which they came."""
    return [each.response["text"] for each in rawlog.envelopes(root, "feed", "notes")]


ROOT = Path(__file__).resolve().parents[2]


def test_everything_once_and_a_second_run_asks_nothing(run: Run, service: Service) -> None:
    assert crawl(run, service) == {"notes": 10, "failed": 0, "left": 0}
    assert set(service.asked.values()) == {1}
    asked = service.asked.total()
    assert crawl(run, service) == {"notes": 0, "failed": 0, "left": 0}
    assert service.asked.total() == asked == 14


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


HEAD, TAIL, SPREAD = range(20), range(180, 200), range(3, 200, 10)


@pytest.mark.parametrize(
    ("status", "where"),
    [(500, HEAD), (200, TAIL), (500, SPREAD)],
    ids=["HTTP 500-first", "no JSON-last", "HTTP 500-spread"],
)
def test_twenty_items_that_always_fail_keep_no_other_from_being_read(
    run: Run, where: range, status: int
) -> None:
    with serving(200, page=40) as service:
        bad = {f"/notes/{service.ids[number]}" for number in where}
        service.fault = lambda path: (status, {"X-Body": "<"}) if path in bad else None
        assert crawl(run, service) == {"notes": 200, "failed": 20, "left": 0}
        assert len(texts(run.root)) == 180
        # Nor does the next run end before them: each is tried once more, and nothing else read.
        tried = {path: service.asked[path] for path in bad}
        assert crawl(run, service) == {"notes": 20, "failed": 20, "left": 0}
        assert all(service.asked[path] == tried[path] + 1 for path in bad)
        assert len(texts(run.root)) == 180


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


class Batches(FeedConnector):
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


SCRIPT = """
import sys
from pathlib import Path
from kb.core.context import Run
from kb.core.config.profile import load_profile
from kb.core.config.settings import load_settings
from tests.crawl.test_loop import FeedConnector, summary, work
root = Path(sys.argv[1])
run = Run(load_settings(dotenv=False, kb_data=root), load_profile("minecraft"), root)
work(run, FeedConnector(run, sys.argv[2]), summary)
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

    class Odd(FeedConnector):
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
