"""What is tried again, how often, and how long one waits."""

from collections.abc import Callable
from typing import Any

import pytest

from kb.core import clock, signals
from kb.core.errors import Blocked, Interrupted, ItemFinal, Retryable, Unreachable
from kb.net import retry


@pytest.fixture
def waits(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    """How long was waited; nobody really waits."""
    found: list[float] = []
    monkeypatch.setattr(retry, "FIRST_S", 0.5)
    monkeypatch.setattr(clock, "sleep", found.append)
    return found


def failing(*errors: Exception) -> Callable[[], str]:
    """Raises the errors one after the other, then answers."""
    left = list(errors)

    def call() -> str:
        if left:
            raise left.pop(0)
        return "answer"

    return call


def test_tried_again_until_it_answers(waits: list[float]) -> None:
    assert retry.attempt(failing(*[Retryable("http 503")] * 4)) == "answer"
    assert len(waits) == 4
    for number, wait in enumerate(waits):
        assert 0.25 * 2**number <= wait <= 0.5 * 2**number


def test_after_the_last_try_the_item_failed(waits: list[float]) -> None:
    with pytest.raises(Retryable, match="http 503"):
        retry.attempt(failing(*[Retryable("http 503")] * 3), tries=3)
    assert len(waits) == 2


def test_without_a_connection_the_item_failed_and_a_needed_service_is_down(
    waits: list[float],
) -> None:
    with pytest.raises(Retryable, match="reset"):
        retry.attempt(failing(*[Retryable("reset", unreachable=True)] * 3), tries=3)
    with pytest.raises(Unreachable, match="3 tries"):
        retry.attempt(
            failing(*[Retryable("reset", unreachable=True)] * 3), tries=3, service="the service"
        )


def test_the_services_own_wish_counts(waits: list[float]) -> None:
    retry.attempt(failing(Retryable("429", after=7.5), Retryable("429", after=0.0)))
    assert waits == [7.5, 0.0]


def test_a_long_wish_stops_the_run(waits: list[float]) -> None:
    with pytest.raises(Blocked) as caught:
        retry.attempt(failing(Retryable("429", after=3600.0)))
    assert caught.value.after == 3600.0
    assert waits == []


@pytest.mark.parametrize(
    "error", [ItemFinal("not_found"), Blocked("captcha"), ValueError("a mistake of ours")]
)
def test_everything_else_leaves_at_once(waits: list[float], error: Exception) -> None:
    with pytest.raises(type(error)):
        retry.attempt(failing(error))
    assert waits == []


def test_a_signal_ends_the_waiting() -> None:
    signals.stop.request("SIGTERM")
    try:
        with pytest.raises(Interrupted):
            retry.attempt(failing(Retryable("503", after=200.0)))
    finally:
        signals.stop.clear()


@pytest.mark.parametrize(
    ("value", "wanted"),
    [
        ("120", 120.0),
        ("0", 0.0),
        ("-5", 0.0),
        (None, None),
        ("", None),
        ("soon", None),
        ("2.5", 2.5),
        ("Fri, 20 Nov 2026 12:01:30 GMT", 90.0),
        ("Fri, 20 Nov 2026 11:00:00 GMT", 0.0),
    ],
)
def test_retry_after_is_a_number_or_a_date(
    monkeypatch: Any, value: str | None, wanted: float | None
) -> None:
    monkeypatch.setenv("KB_NOW", "2026-11-20T12:00:00Z")
    assert retry.retry_after(value) == wanted


def test_a_date_counts_from_the_answers_own_date(monkeypatch: Any) -> None:
    monkeypatch.setenv("KB_NOW", "2020-01-01T00:00:00Z")
    assert (
        retry.retry_after("Fri, 20 Nov 2026 12:00:03 GMT", "Fri, 20 Nov 2026 12:00:00 GMT") == 3.0
    )
    assert retry.retry_after("2", "Fri, 20 Nov 2026 12:00:00 GMT") == 2.0
    assert retry.retry_after("inf") is None
    assert retry.retry_after("1e15") == 366 * 24 * 3600
