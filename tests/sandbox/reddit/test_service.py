"""Tests of the sandbox's Reddit API."""

from collections.abc import Iterator
from typing import Any

import pytest
import requests

from kb.sandbox.reddit.service import CLIENT, SECRET
from kb.sandbox.reddit.subreddit import Subreddit
from kb.sandbox.world import World
from tests.faults import Sandbox


@pytest.fixture(scope="module")
def sandbox() -> Iterator[Sandbox]:
    world = World(n_channels=1, n_videos=1)
    world.reddit = Subreddit(0, 130, width=5, depth=3)
    with Sandbox(world, services=["reddit"]) as running:
        yield running


@pytest.fixture(scope="module")
def api(sandbox: Sandbox) -> Any:
    """api(path, …) → the answer as JSON, asked with a token."""
    url = sandbox.settings()["KB_REDDIT_ENDPOINT"]
    token = requests.post(f"{url}/api/v1/access_token", auth=(CLIENT, SECRET), timeout=60).json()
    headers = {"Authorization": f"bearer {token['access_token']}"}

    def get(path: str, **params: Any) -> Any:
        return requests.get(f"{url}/{path}", params=params, headers=headers, timeout=60).json()

    return get


def test_without_a_token_nothing_is_answered(sandbox: Sandbox) -> None:
    url = sandbox.settings()["KB_REDDIT_ENDPOINT"]
    assert requests.get(f"{url}/r/Minecraft/new", timeout=60).status_code == 401
    refused = requests.post(f"{url}/api/v1/access_token", auth=(CLIENT, "x"), timeout=60)
    assert refused.status_code == 401


def test_a_listing_has_at_most_a_hundred_posts_a_page(api: Any, sandbox: Sandbox) -> None:
    first = api("r/Minecraft/new", limit=500)["data"]
    assert len(first["children"]) == 100
    second = api("r/Minecraft/new", limit=500, after=first["after"])["data"]
    assert second["after"] is None
    names = {one["data"]["name"] for part in (first, second) for one in part["children"]}
    assert names == {f"t3_{key}" for key in sandbox.world.reddit.posts}


def test_info_answers_for_names_and_leaves_out_unknown_ones(api: Any, sandbox: Sandbox) -> None:
    post, comment = (
        next(iter(sandbox.world.reddit.posts)),
        next(iter(sandbox.world.reddit.comments)),
    )
    asked = [f"t3_{post}", f"t1_{comment}", "t1_zzzzzz"]
    answer = api("api/info", id=",".join(asked))["data"]["children"]
    assert [one["data"]["name"] for one in answer] == asked[:2]
