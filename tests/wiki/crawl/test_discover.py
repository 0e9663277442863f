"""Rounds of a crawl without a page to show: lists that go on, states of before, when a browser
starts.
"""

import contextlib
from pathlib import Path
from typing import Any

import pytest

from kb.core.context import Run
from kb.core.errors import NothingRead
from kb.store.layout import Layout
from kb.store.state import tombstones
from kb.store.state.frontier import Frontier
from kb.wiki.browser import chromium
from kb.wiki.crawl.connector import crawl
from tests.wiki.small_wiki import SmallWiki

NAMES = {"": ["Alpha", "Beta"], "Gamma": ["Gamma", "Delta"], "Eps": ["Eps"]}


@pytest.fixture
def wiki(serve: Any, programs: chromium.Programs) -> SmallWiki:
    """A wiki whose list has three parts, and whose pages are gone when they are asked for."""
    held = SmallWiki()
    held.url = serve(held.application)
    held.hook = lambda request: part(request.args) if request.args.get("list") else None
    return held


def part(args: Any) -> dict[str, Any]:
    """A part of the list, and where it goes on."""
    at = args.get("apcontinue", "")
    places = list(NAMES)
    following = places[places.index(at) + 1 :]
    going = {"continue": {"apcontinue": following[0], "continue": "-||"}} if following else {}
    pages = [{"pageid": len(name), "ns": 0, "title": name} for name in NAMES[at]]
    return {**going, "query": {"allpages": pages}}


@pytest.fixture
def run(wiki: SmallWiki, run_on: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Run:
    """A fresh data root; a browser that starts is a failure."""
    monkeypatch.setattr("kb.wiki.crawl.http_client.TRIES", 2)
    monkeypatch.setattr("kb.wiki.crawl.connector.Pool", None)
    made: Run = run_on(tmp_path / "data", wiki.url)
    return made


def test_a_list_goes_on_where_it_stopped_and_no_browser_starts(wiki: SmallWiki, run: Run) -> None:
    asked: list[str] = []

    def listed(request: Any) -> Any:
        if not request.args.get("list"):
            return None
        at = request.args.get("apcontinue", "")
        asked.append(at)
        return (
            {"error": {"code": "internal_api_error"}}
            if len(asked) in (3, 4)
            else part(request.args)
        )

    wiki.hook = listed
    summary = crawl(run)  # what was listed before is read
    assert (summary["failed"], summary["missing"], summary["left"]) == (1, 4, 0)
    summary = crawl(run)
    assert asked == ["", "Gamma", "Eps", "Eps", "Eps"]
    assert (summary["missing"], summary["left"]) == (5, 0)
    assert crawl(run)["requests"] == 0


def test_every_request_of_ours_stands_in_the_ledger_before_it_goes_out(
    wiki: SmallWiki, run: Run
) -> None:
    rows: list[int] = []

    def look(request: Any) -> Any:
        with contextlib.closing(
            Frontier(Layout(run.root).state("wiki"), readonly=True)
        ) as frontier:
            rows.append(frontier.requests()[0])
        return part(request.args) if request.args.get("list") else None

    wiki.hook = look
    summary = crawl(run)
    assert rows == list(range(1, len(wiki.asked) + 1))
    assert summary["requests"] == len(wiki.asked)
    with contextlib.closing(Frontier(Layout(run.root).state("wiki"), readonly=True)) as frontier:
        by_name = {endpoint: n for _, _, endpoint, n, _ in frontier.ledger()}
    assert set(by_name) == {"robots.txt", "file", "api.php"}
    assert sum(by_name.values()) == len(wiki.asked)


def test_a_list_that_was_stopped_is_none_of_a_run_with_titles(
    wiki: SmallWiki, run: Run, tmp_path: Path
) -> None:
    """Neither read on nor compared: what is not listed yet is not gone."""
    whole = wiki.hook
    wiki.hook = lambda request: (
        {"error": {"code": "internal_api_error"}}
        if request.args.get("apcontinue")
        else whole(request)
    )
    assert crawl(run)["failed"] == 1
    with pytest.raises(NothingRead, match="internal_api_error"):
        crawl(run)
    wiki.hook = lambda request: pytest.fail("listed") if request.args.get("list") else None
    names = tmp_path / "titles.txt"
    names.write_text("Zeta\n")
    assert crawl(run, names)["missing"] == 3
    wiki.hook = whole
    assert crawl(run)["missing"] == 6


def test_a_state_of_before_is_understood(wiki: SmallWiki, run: Run) -> None:
    """Payloads without names of types, and the cursors that lists had."""
    frontier = Frontier(run.root / "state" / "wiki.sqlite")
    page = {"title": "Alpha", "url": f"{wiki.url}/wiki/Alpha", "revision_id": 10, "round": 1}
    more = {"rendered": [10, "Alpha"], "former": ["Aleph"], "final": None, "gone": False}
    frontier.add_keys(
        "pages", [("1", page | more), ("2", page | {"title": "Beta", "rendered": None})]
    )
    frontier.add_keys("info", [("1:Alpha", {"title": "Alpha"}), ("1:Nope", {"title": "Nope"})])
    frontier.add_keys("files", [("f", {"key": "f", "title": "File:F.png", "src": "f"})])
    frontier.done("pages", "1", "2")
    frontier.done("info", "1:Alpha")
    frontier.skip("info", "1:Nope", "missing")
    frontier.done("files", "f")
    frontier.set_cursor("round", {"number": 1, "done": False})
    frontier.set_cursor("site:1", {"namespaces": [0]})
    frontier.set_cursor("list:1:0", "done")
    frontier.close()
    summary = crawl(run)
    assert (summary["crawled_in_all"], summary["missing"], summary["left"]) == (7, 5, 0)
    assert wiki.asked
    assert tombstones.keys(run.root, "wiki") == {"Aleph"}
