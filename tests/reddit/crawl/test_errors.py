"""Real exchanges, replayed through real PRAW: what is sent, and what follows from each answer."""

import json
from collections.abc import Callable
from pathlib import Path

import pytest
import requests

from kb.core.config.profile import load_profile
from kb.core.config.settings import load_settings
from kb.core.context import Run
from kb.core.errors import FatalError, ItemFinal
from kb.net.rate import Pace
from kb.reddit.crawl import client as room
from kb.reddit.crawl.client import Client, Limiter
from kb.reddit.restore.reconstruct import rebuild
from tests.reddit.cassettes import Cassette, Exchange, read
from tests.reddit.work import rows

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
    recorded: Path, play: Callable[[list[Exchange]], Cassette], name: str
) -> None:
    exchanges = read(recorded / "reddit" / f"{name}.json")
    cassette, ledger = play(exchanges), []

    def spend(endpoint: str, units: int) -> Callable[[str], None]:
        ledger.append([endpoint, units, None])
        return lambda outcome: ledger[-1].__setitem__(2, outcome)

    client = Client(settings(), spend, requests_per_minute=1e9)
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
    assert [(units, outcome) for _, units, outcome in ledger] == [
        (int("access_token" not in one.path), str(one.status)) for one in exchanges
    ]
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
