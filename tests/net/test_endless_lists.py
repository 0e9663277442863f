"""Lists that a service never ends: each is one failed item or one line, after a number of requests
that no real service meets.
"""

import itertools
import json
from collections.abc import Callable, Iterator
from contextlib import closing
from pathlib import Path
from typing import Any
from urllib.parse import parse_qs

import pytest

from kb.net import limits, retry
from kb.sandbox.world import World
from kb.store.layout import Layout
from kb.store.state.frontier import Frontier
from tests.faults import Sandbox
from tests.inprocess import Here

fresh = itertools.count()


@pytest.fixture(scope="module")
def sandbox() -> Iterator[Sandbox]:
    with Sandbox(World(n_channels=2, n_videos=4, n_posts=24, width=600, depth=8)) as running:
        yield running


def asked(environ: dict[str, Any]) -> dict[str, str]:
    query = environ.get("QUERY_STRING", "")
    if environ["REQUEST_METHOD"] == "POST":
        query = environ["wsgi.input"].read(int(environ["CONTENT_LENGTH"])).decode()
    return {name: values[0] for name, values in parse_qs(query).items()}


def new_titles(environ: dict[str, Any]) -> Any:
    n = next(fresh)
    return {
        "continue": {"apcontinue": f"T{n}", "continue": "-||"},
        "query": {"allpages": [{"pageid": 10_000 + n, "ns": 0, "title": f"T{n}"}]},
    }


def new_steps(environ: dict[str, Any]) -> Any:
    pages = [{"pageid": 1, "title": "Alpha", "ns": 0}]
    return {"continue": {"pccontinue": f"1|{next(fresh)}"}, "query": {"pages": pages}}


def new_redirects(environ: dict[str, Any]) -> Any:
    n = next(fresh)
    redirects = [{"pageid": n, "title": f"R{n}-{i}" + "x" * 1_000} for i in range(500)]
    pages = [{"pageid": 1, "title": "Alpha", "ns": 0, "redirects": redirects}]
    return {"continue": {"rdcontinue": str(n)}, "query": {"pages": pages}}


def new_videos(environ: dict[str, Any]) -> Any:
    n = next(fresh)
    items = [{"contentDetails": {"videoId": f"v{n:010d}"}}]
    return {"items": items, "nextPageToken": f"token{n}"}


def no_videos(environ: dict[str, Any]) -> Any:
    return {"items": [], "nextPageToken": f"token{next(fresh)}"}


def new_channels(environ: dict[str, Any]) -> Any:
    n = next(fresh)
    found = {"id": {"kind": "youtube#channel", "channelId": f"UC{n:022d}"}}
    return {"items": [found], "nextPageToken": f"token{n}"}


def no_posts(environ: dict[str, Any]) -> Any:
    data = {"after": f"t3_{next(fresh):x}", "children": []}
    return {"kind": "Listing", "data": data}


def new_stubs(environ: dict[str, Any]) -> Any:
    post = asked(environ)["link_id"]
    data = {"parent_id": post, "children": [f"q{next(fresh):x}"], "count": 1}
    return {"json": {"errors": [], "data": {"things": [{"kind": "more", "data": data}]}}}


WIKI = ("wiki", "crawl", "--limit", "1")
LISTS: dict[str, tuple[str, str, Callable[[dict[str, Any]], Any], tuple[str, ...], str]] = {
    "new titles": ("wiki", "list=allpages", new_titles, WIKI, "the list of namespace 0"),
    "steps without entries": ("wiki", "prop=info", new_steps, WIKI, "the wiki's answer"),
    "new redirects": ("wiki", "prop=info", new_redirects, WIKI, "the wiki's answer"),
    "new videos": ("youtube", "playlistItems", new_videos, ("youtube", "crawl"), "the list UU"),
    "no videos": ("youtube", "playlistItems", no_videos, ("youtube", "crawl"), "the list UU"),
    "new channels": ("youtube", "v3/search", new_channels, ("youtube", "crawl"), ""),
    "no posts": ("reddit", "/r/[^/]+/(new|top|search)", no_posts, ("reddit", "crawl"), ""),
    "new stubs": ("reddit", "/morechildren", new_stubs, ("reddit", "crawl"), "the comments of"),
}
PARTS = 10


@pytest.mark.parametrize("name", LISTS)
def test_a_list_without_end_is_given_up(
    sandbox: Sandbox, here: Here, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    monkeypatch.setattr(retry, "FIRST_S", 0.0001)
    monkeypatch.setattr(limits, "ANSWER_BYTES", 5_000_000)
    monkeypatch.setattr("kb.wiki.crawl.client._LISTED", PARTS)
    monkeypatch.setattr("kb.wiki.crawl.client._CONTINUED", PARTS)
    monkeypatch.setattr("kb.youtube.crawl.fetch.PAGES", PARTS)
    monkeypatch.setattr("kb.reddit.crawl.connector.PARTS", PARTS)
    service, path, answer, words, why = LISTS[name]
    settings = sandbox.settings() | {"KB_DATA": str(tmp_path / "data")}
    sandbox.faults.clear()
    if path == "playlistItems":
        here("youtube", "crawl", "--only", "channels", env=settings)
    fault = sandbox.faults.add(
        path,
        service=service,
        status=200,
        times=None,
        body=lambda environ: json.dumps(answer(environ)).encode(),
        headers={"Content-Type": "application/json"},
    )
    more = ("--only", "uploads") if path == "playlistItems" else ()
    done = here(*words, *more, "--json", env=settings)
    assert "unexpected" not in done.err
    assert done.code == int("none of" in done.said), done.err
    assert 0 < fault.hits < 20 * PARTS
    with closing(Frontier(Layout(tmp_path / "data").state(service), readonly=True)) as frontier:
        kinds = frontier.kinds()
        failed = [reason for kind in kinds for _, _, reason, _ in frontier.items(kind, "error")]
    assert bool(failed) == bool(why), done
    assert all(reason.startswith(why) for reason in failed), failed
