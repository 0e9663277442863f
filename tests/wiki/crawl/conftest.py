"""A small wiki, and the client that asks it."""

from pathlib import Path

import pytest

from kb.wiki.crawl.client import WikiApi
from kb.wiki.crawl.http_client import WikiHosts
from tests.wiki.small_wiki import SmallWiki


@pytest.fixture
def wiki(serve):
    held = SmallWiki()
    held.url = serve(held.application)
    held.add(1, "Alpha")
    return held


@pytest.fixture
def web(wiki, run_on, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> WikiHosts:
    monkeypatch.setattr("kb.wiki.crawl.http_client.TRIES", 2)
    return WikiHosts(run_on(tmp_path, wiki.url), wiki.url, (), 0.0)


@pytest.fixture
def api(wiki, web: WikiHosts) -> WikiApi:
    return WikiApi(f"{wiki.url}/w/api.php", web)
