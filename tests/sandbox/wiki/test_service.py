"""Tests of the sandbox's wiki as a service."""

import requests

from kb.sandbox.world import World
from tests.faults import Sandbox
from tests.sandbox.answers import ask


def test_the_list_of_pages_goes_on_where_it_ended() -> None:
    with Sandbox(World(n_channels=1, n_videos=1), services=["wiki"]) as services:
        root = services.settings()["KB_WIKI_URL"]
        titles: list[str] = []
        going: dict[str, str] = {}
        while True:
            answer = ask(root, list="allpages", aplimit="7", **going)
            titles += [one["title"] for one in answer["query"]["allpages"]]
            if "continue" not in answer:
                break
            going = answer["continue"]
        assert len(titles) == len(set(titles)) > 7
        page = requests.get(f"{root}/wiki/{titles[0]}", timeout=9)
        assert page.status_code == 200
        assert "http://wiki.example" not in page.text
        assert requests.get(f"{root}/wiki/No such page", timeout=9).status_code == 404
        assert requests.get(f"{root}/images/none.png", timeout=9).status_code == 404
