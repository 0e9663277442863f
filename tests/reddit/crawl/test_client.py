"""Tokens that can't be read, and the window of requests that Reddit announces."""

from time import monotonic
from typing import Any

import pytest

from kb.core.errors import Blocked, CredentialRefused, LimitReached, Unreachable
from kb.net.rate import Pace
from kb.reddit.crawl.client import Limiter
from tests.reddit.crawl.test_reduce import Said
from tests.reddit.work import Work

TOKEN = {"access_token": "sandbox-reddit-token", "expires_in": 86_400, "scope": "*"}


def rate(remaining: object, reset: object) -> dict[str, str]:
    return {
        "x-ratelimit-used": "1000",
        "x-ratelimit-remaining": str(remaining),
        "x-ratelimit-reset": str(reset),
    }


@pytest.mark.parametrize(
    "body",
    [
        '{"access_token": "a',
        "<html>portal</html>",
        "{}",
        "[]",
        "null",
        "[" * 2_000 + "]" * 2_000,
        *({name: value for name, value in TOKEN.items() if name != left_out} for left_out in TOKEN),
        {**TOKEN, "expires_in": "soon"},
        {"error": 429, "message": "Too Many Requests"},
        {"error": "503"},
    ],
    ids=lambda body: str(body)[:30],
)
def test_a_token_that_can_not_be_read_is_asked_for_again(few: Work, body: Any) -> None:
    fault = few.sandbox.faults.add("access_token", status=200, body=body, times=2)
    with pytest.raises(LimitReached):
        few.crawl(limit=1)
    assert fault.hits == 2


@pytest.mark.parametrize(
    ("body", "error"),
    [
        ("{}", Unreachable),
        ({"error": 429}, Blocked),
        ({"error": "invalid_grant"}, CredentialRefused),
    ],
)
def test_a_token_without_end(few: Work, body: Any, error: type[Exception]) -> None:
    few.section["listings"] = ("new", "hot", "rising")
    few.sandbox.faults.add("access_token", status=200, body=body, times=None)
    with pytest.raises(error):
        few.crawl()


@pytest.mark.parametrize("status", [500, 429])
def test_a_window_that_is_long_used_up_stops_the_run_with_the_time_to_come_back(
    few: Work, status: int
) -> None:
    fault = few.sandbox.faults.add(
        "^/comments/", status=status, headers=rate(0.0, 400), after=1, times=None
    )
    for hits in (1, 2):
        with pytest.raises(Blocked, match=r"401 s, at 2026-11-20T12:06:4[01]Z") as stopped:
            few.crawl()
        assert 399 < (stopped.value.after or 0) <= 401
        assert fault.hits == hits, "each run tries it by one request"


def test_wait_sleeps_through_it(few: Work, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("kb.reddit.crawl.client.PATIENCE_S", 0.5)
    few.sandbox.faults.add("^/comments/", status=500, headers=rate(0.0, 0))
    said = Said()
    start = monotonic()
    with pytest.raises(LimitReached):
        few.crawl(limit=1, wait=True, progress=said)
    assert monotonic() - start >= 1
    assert len(said.lines) == 1
    assert said.lines[0].startswith("waiting 1 s: Reddit's rate limit is used up")


def test_a_short_wait_is_said_once(few: Work) -> None:
    few.sandbox.faults.add("^/comments/", status=500, headers=rate(0.3, 0))
    said = Said()
    with pytest.raises(LimitReached):
        few.crawl(limit=2, progress=said)
    assert said.lines == ["waiting 1 s for Reddit's window"]


def test_seconds_that_are_rounded_down_let_no_request_through_too_early(
    few: Work, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A window of three requests in 1.4 s, as the service counts them."""
    windows: list[list[float]] = [[]]

    def room(service: Any) -> dict[str, str]:
        if windows[-1] and monotonic() >= windows[-1][0] + 1.4:
            windows.append([])
        windows[-1].append(monotonic())
        return rate(f"{max(0, 3 - len(windows[-1]))}.0", int(windows[-1][0] + 1.4 - monotonic()))

    monkeypatch.setattr("kb.sandbox.reddit.service.RedditService._room", room)
    with pytest.raises(LimitReached):
        few.crawl(limit=6)
    sizes = [len(window) for window in windows]
    assert (max(sizes), sum(sizes)) == (3, 8)


@pytest.mark.parametrize(
    "headers", [{}, rate("nan", 5), rate(0, "inf"), rate("", ""), {"x-ratelimit-remaining": "0"}]
)
def test_headers_that_say_nothing_change_nothing(headers: dict[str, str]) -> None:
    limiter = Limiter(Pace(0))
    limiter.heed(headers)
    limiter.wait()
    limiter.heed(rate(0, 3600))
    limiter.heed(headers)
    with pytest.raises(Blocked):
        limiter.wait()


def test_a_wait_beyond_the_calendar_is_a_day_at_most() -> None:
    limiter = Limiter(Pace(0))
    limiter.heed(rate(0, 1e300))
    with pytest.raises(Blocked) as stopped:
        limiter.wait()
    assert (stopped.value.after or 0) <= 86_401
