"""Space between requests, over all threads."""

import threading

import pytest

from kb.core import clock
from kb.core.config.addresses import is_loopback
from kb.net.rate import Pace


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
