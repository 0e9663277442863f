"""Quotas of services, kept in the ledger."""

import socket
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import pytest

from kb.core.config.settings import load_settings
from kb.core.context import Run
from kb.core.errors import QuotaSpent, Retryable
from kb.crawl.connector import Opened
from kb.crawl.quota import Quota
from kb.net.session import HttpSession, send
from kb.store.state.frontier import Frontier


@pytest.fixture
def opened(run: Run, tmp_path: Path) -> Iterator[Opened]:
    with closing(Frontier(tmp_path / "ledger.sqlite")) as frontier:
        yield Opened(run=run, frontier=frontier)


@pytest.mark.parametrize(
    ("zone", "now", "day", "reset"),
    [
        ("UTC", "2026-11-20T23:59:59Z", "2026-11-20", "2026-11-21T00:00:00Z"),
        ("America/Los_Angeles", "2026-11-20T07:59:59Z", "2026-11-19", "2026-11-20T08:00:00Z"),
        # The clocks go back on 1 November: a day of 25 hours.
        ("America/Los_Angeles", "2026-11-01T07:00:00Z", "2026-11-01", "2026-11-02T08:00:00Z"),
        ("Asia/Tokyo", "2026-11-20T15:00:00Z", "2026-11-21", "2026-11-21T15:00:00Z"),
    ],
)
def test_a_quota_is_one_of_the_services_own_day(
    opened: Opened, monkeypatch: pytest.MonkeyPatch, zone: str, now: str, day: str, reset: str
) -> None:
    monkeypatch.setenv("KB_NOW", now)
    quota = Quota("searches", "the quota", 3, zone)
    opened.spend(quota, "search", 2)
    with pytest.raises(QuotaSpent, match=f"the quota is spent; it is reset at {reset}"):
        opened.spend(quota, "search", 2)
    opened.spend(quota, "search")
    assert opened.frontier.ledger() == [(day, "searches", "search", 2, 3)]
    monkeypatch.setenv("KB_NOW", reset)
    opened.spend(quota, "search", 3)


def test_a_request_that_reached_nobody_costs_no_units(opened: Opened) -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        nobody = f"http://127.0.0.1:{taken.getsockname()[1]}"
    ledger = Quota("units", "the quota", 1)
    session = HttpSession(
        load_settings(dotenv=False), ledger=lambda request: opened.spend(ledger, "list")
    )
    for _ in range(2):
        with pytest.raises(Retryable):
            send(session, "GET", nobody)
    assert opened.requests() == (2, 0)
