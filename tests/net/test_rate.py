"""Space between requests, over all threads."""

from __future__ import annotations

import threading

import pytest

from kb.core import clock
from kb.core.config.addresses import is_loopback
from kb.net.rate import Pace
from kb.net.robots import Robots, robots_url


def test_threads_share_one_pace(monkeypatch: pytest.MonkeyPatch) -> None:
    """With a clock that stands still, each turn's wait is its place in the line."""
    waits: list[float] = []
    monkeypatch.setattr(clock, "monotonic", lambda: 100.0)
    monkeypatch.setattr(clock, "sleep", waits.append)
    pace = Pace(2.0)
    threads = [threading.Thread(target=pace.wait) for _ in range(8)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert sorted(waits) == [2.0 * place for place in range(8)]


def test_a_rest_counts_for_everyone_and_a_pace_only_gets_slower(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    waits: list[float] = []
    monkeypatch.setattr(clock, "monotonic", lambda: 0.0)
    monkeypatch.setattr(clock, "sleep", waits.append)
    pace = Pace(1.0)
    pace.at_least(0.1)
    pace.wait()
    pace.wait()
    pace.at_least(3.0)
    pace.rest(10.0)
    pace.wait()
    pace.wait()
    assert waits == [0.0, 1.0, 10.0, 13.0]


@pytest.mark.parametrize(
    ("url", "wanted"),
    [
        ("http://127.0.0.1:8000", True),
        ("http://localhost:1/x", True),
        ("http://[::1]:80", True),
        ("http://127.9.9.9", True),
        ("https://www.youtube.com", False),
        ("http://10.0.0.1", False),
        ("http://127.0.0.1.example.org", False),
    ],
)
def test_loopback(url: str, wanted: bool) -> None:
    assert is_loopback(url) is wanted


RULES = (
    "User-agent: *\nDisallow: /private\nCrawl-delay: 5\n\nUser-agent: lorecrawl\nDisallow:"
    " /no\nCrawl-delay: 0.5\n"
)


def test_robots_by_agent() -> None:
    ours, others = Robots(RULES, "lorecrawl/1.0"), Robots(RULES, "other")
    assert (ours.allows("http://w/private/x"), ours.allows("http://w/no"), ours.crawl_delay) == (
        True,
        False,
        0.5,
    )
    assert (others.allows("http://w/private/x"), others.crawl_delay) == (False, 5.0)


def test_robots_know_us_by_our_product_token_alone() -> None:
    agent = "lorecrawl/1.0 (+mail@example.org)"
    assert Robots("User-agent: example\nDisallow: /\n", agent).allows("http://w/x")
    ours = Robots(
        "User-agent: *\nDisallow: /\n\nUser-Agent: Lorecrawl/2.1 # you\nDisallow: /no\n", agent
    )
    assert (ours.allows("http://w/x"), ours.allows("http://w/no"), ours.named) == (
        True,
        False,
        True,
    )
    assert not Robots("User-agent: *\nDisallow: /\n", agent).named


def test_robots_by_answer() -> None:
    assert Robots.of_answer(404, "<html>", "a").allows("http://w/x")
    assert not Robots.of_answer(503, "", "a").allows("http://w/x")
    assert Robots.of_answer(200, "", "a").crawl_delay is None
    assert robots_url("https://w.org:8443/wiki/A?b") == "https://w.org:8443/robots.txt"
