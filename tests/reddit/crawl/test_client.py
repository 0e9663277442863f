"""Reddit's client: requests, limits, and what follows from errors."""

import json
import sqlite3
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import requests

from kb.core import clock
from kb.core.config.profile import load_profile
from kb.core.config.section import ERROR, NOTE, WARNING, QuestionCost
from kb.core.config.settings import load_settings
from kb.core.context import Run
from kb.core.errors import (
    Blocked,
    CredentialRefused,
    FatalError,
    ItemFinal,
    LimitReached,
    Unreachable,
)
from kb.crawl.connector import Opened
from kb.net.rate import Pace
from kb.reddit.crawl import client as room
from kb.reddit.crawl.client import Client, Limiter, question
from kb.reddit.restore.reconstruct import rebuild
from kb.store.state.frontier import Frontier
from tests.reddit.cassettes import Cassette, Exchange, read
from tests.reddit.crawl.test_reduce import Said
from tests.reddit.work import Work, rows

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


def test_wait_sleeps_through_it(few: Work, hasty: None, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("kb.reddit.crawl.client.PATIENCE_S", 0.5)
    few.sandbox.faults.add("^/comments/", status=500, headers=rate(0.0, 0))
    said = Said()
    start = clock.monotonic()
    with pytest.raises(LimitReached):
        few.crawl(limit=1, wait=True, progress=said)
    assert clock.monotonic() - start >= 1
    assert len(said.lines) == 1
    assert said.lines[0].startswith("waiting 1 s: Reddit's rate limit is used up")


def test_a_short_wait_is_said_once(few: Work, hasty: None) -> None:
    few.sandbox.faults.add("^/comments/", status=500, headers=rate(0.3, 0))
    said = Said()
    with pytest.raises(LimitReached):
        few.crawl(limit=2, progress=said)
    assert said.lines == ["waiting 1 s for Reddit's window"]


def test_seconds_that_are_rounded_down_let_no_request_through_too_early(
    few: Work, hasty: None, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A window of three requests in 1.4 s, as the service counts them."""
    windows: list[list[float]] = [[]]

    def room(service: Any) -> dict[str, str]:
        if windows[-1] and clock.monotonic() >= windows[-1][0] + 1.4:
            windows.append([])
        windows[-1].append(clock.monotonic())
        return rate(
            f"{max(0, 3 - len(windows[-1]))}.0", int(windows[-1][0] + 1.4 - clock.monotonic())
        )

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


AGENT = "lorecrawl"
# Exchanges of an app alone; those with a user's password or a refresh token need what we never
# have.
APP_ONLY = (
    "TestComment.test_attributes",
    "TestComment.test_invalid",
    "TestComment.test_parent__chain",
    "TestComment.test_refresh__deleted_comment",
    "TestComment.test_refresh__with_reply_sort_and_limit",
    "TestCommentForest.test_replace__all",
    "TestCommentForest.test_replace__on_direct_comment",
    "TestReddit.test_info",
    "TestReddit.test_info_url",
    "TestSubmission.test_comments",
    "TestSubmission.test_duplicates",
    "TestSubreddit.test_search",
    "TestSubredditListings.test_new",
    "TestSubredditListings.test_top",
    "TestListingGenerator.test_exhaust_items",
    "TestListingGenerator.test_no_items",
    "TestRedditorListings.test_saved__in_read_only_mode",
    "TestSubreddit.test_sticky",
    "TestSubreddit.test_sticky__not_set",
    "TestReddit.test_bad_request_without_json_text_html_response",
    "TestRedditors.test_partial_redditors__not_found",
    "TestRedditorListings.test_overview__top",
)


@pytest.fixture
def play(monkeypatch: pytest.MonkeyPatch) -> Callable[[list[Exchange]], Cassette]:
    """PRAW as the client makes it, with a cassette in place of the network."""

    def mount(exchanges: list[Exchange]) -> Cassette:
        cassette, made = Cassette(exchanges), room._praw

        def praw(*arguments: object) -> object:
            reddit = made(*arguments)
            # Behind our door: hosts and the ledger are met as with the real network.
            door = reddit._core.requestor._http.get_adapter("https://")
            monkeypatch.setattr(door, "pass_on", cassette.send)
            return reddit

        monkeypatch.setattr(room, "_praw", praw)
        return cassette

    return mount


def settings() -> object:
    return load_settings(
        dotenv=False,
        reddit_client_id="an-app",
        reddit_client_secret="a-secret",
        kb_contact="me@example.org",
    )


@pytest.mark.parametrize("name", APP_ONLY)
def test_each_recorded_answer_has_its_consequence(
    recorded: Path, play: Callable[[list[Exchange]], Cassette], name: str, tmp_path: Path
) -> None:
    exchanges = read(recorded / "reddit" / f"{name}.json")
    cassette, profile = play(exchanges), load_profile("minecraft")
    section = profile.section("reddit").model_copy(update={"requests_per_minute": 1e9})
    frontier = Frontier(tmp_path / "ledger.sqlite")
    run = Run(settings=settings(), profile=profile, root=tmp_path)
    client = Client(Opened(run=run, frontier=frontier), section)
    for exchange in exchanges:
        if "access_token" in exchange.path:
            continue

        def ask(exchange: Exchange = exchange) -> object:
            return (
                client.get(exchange.path.lstrip("/"), exchange.query)
                if exchange.method == "GET"
                else client.post(exchange.path.lstrip("/"), exchange.form)
            )

        if exchange.status == 200:
            assert ask() == json.loads(exchange.body)
        elif exchange.status == 400:
            with pytest.raises(FatalError, match="400"):
                ask()
        else:
            with pytest.raises(ItemFinal) as final:
                ask()
            assert (
                final.value.reason
                == {302: "redirect", 301: "redirect", 403: "forbidden", 404: "not_found"}[
                    exchange.status
                ]
            )
    assert cassette.left == []
    # A ledger row for every request, before it was sent; tokens cost no unit.
    frontier.close()
    with sqlite3.connect(tmp_path / "ledger.sqlite") as state:
        ledger = state.execute("SELECT units, outcome FROM ledger ORDER BY id").fetchall()
    assert ledger == [(int("access_token" not in one.path), str(one.status)) for one in exchanges]
    for request in cassette.asked:
        assert request.headers["User-Agent"].startswith(AGENT)
        assert "me@example.org" in request.headers["User-Agent"]
        assert "secret" not in (request.url or "")


def test_a_recorded_post_through_the_whole_reconstruction(
    recorded: Path, play: Callable[[list[Exchange]], Cassette], tmp_path: Path
) -> None:
    cassette = play(read(recorded / "reddit" / "TestSubmission.test_comments.json"))
    ids = tmp_path / "reddit.json"
    ids.write_text('[{"id": "2gmzqe", "type": "text"}]')
    profile = load_profile("minecraft")
    profile = profile.model_copy(
        update={"reddit": profile.section("reddit").model_copy(update={"requests_per_minute": 1e9})}
    )
    summary = rebuild(
        Run(settings=settings(), profile=profile, root=tmp_path / "data"), ids, tmp_path / "out"
    )
    assert (summary["posts"], summary["comments"], summary["missing"], summary["requests"]) == (
        1,
        2,
        0,
        2,
    )
    assert cassette.left == []
    post, (first, second) = rows(tmp_path / "out" / "posts")[0], rows(tmp_path / "out" / "comments")
    assert (post["post_id"], post["type"], post["score"], post["num_comments"]) == (
        "2gmzqe",
        "text",
        11,
        2,
    )
    assert {first["depth"], second["depth"]} == {0, 1}
    assert {first["post_id"], second["post_id"]} == {"2gmzqe"}


def test_rate_headers_of_a_recorded_answer(recorded: Path) -> None:
    headers = next(
        one.headers
        for one in read(recorded / "reddit" / "TestRedditorListings.test_overview__top.json")
        if any("ratelimit" in name.lower() for name in one.headers)
    )
    limiter = Limiter(Pace(0))
    answer = requests.Response()
    answer.headers.update(headers)
    limiter.heed({"x-ratelimit-remaining": "0", "x-ratelimit-reset": "3600"})
    limiter.heed(answer.headers)
    limiter.wait()  # there is room: no pause


def test_the_subreddit_s_own_page_is_asked_for_once(few: Work) -> None:
    cost = QuestionCost()
    assert question(few.run(), cost).level == NOTE
    assert cost.requests == len(few.sandbox.ledger.requests()) == 2  # the token, the page


@pytest.mark.parametrize(
    ("status", "body", "level"),
    [
        (200, {"kind": "t5", "data": {"display_name": "Minecraft", "over18": True}}, WARNING),
        (403, {"reason": "private", "message": "Forbidden"}, ERROR),
        (404, {"reason": "banned", "message": "Not Found"}, ERROR),
    ],
)
def test_what_is_wrong_with_it_is_found(few: Work, status: int, body: object, level: str) -> None:
    few.sandbox.faults.add("/about", status=status, body=body, times=None)
    assert question(few.run(), QuestionCost()).level == level
