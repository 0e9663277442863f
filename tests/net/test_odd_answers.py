"""Answers of services that no service gives: one line with what to do, never "unexpected"."""

from collections.abc import Iterator
from pathlib import Path

import pytest

from kb.net import limits, retry
from kb.sandbox.world import World
from tests.faults import Sandbox
from tests.inprocess import Here

DEEP = "[" * 100_000 + "]" * 100_000


@pytest.fixture(scope="module")
def sandbox() -> Iterator[Sandbox]:
    with Sandbox(World()) as running:
        yield running


@pytest.mark.parametrize("body", [DEEP, " " * 200_000], ids=["deep", "large"])
@pytest.mark.parametrize("status", [200, 400])
@pytest.mark.parametrize(
    ("source", "path"),
    [
        ("youtube", "/youtube/v3/"),
        ("reddit", "/api/v1/access_token"),
        ("reddit", "/r/"),
        ("wiki", "/api.php"),
    ],
    ids=["Data API", "Reddit's token", "Reddit's API", "MediaWiki's API"],
)
def test_an_answer_that_is_too_deep_or_too_large_is_one_line(
    sandbox: Sandbox,
    here: Here,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    source: str,
    path: str,
    status: int,
    body: str,
) -> None:
    monkeypatch.setattr(retry, "FIRST_S", 0.0001)
    monkeypatch.setattr(limits, "ANSWER_BYTES", 199_999)
    monkeypatch.setattr("kb.wiki.crawl.http_client.TRIES", 2)
    sandbox.faults.clear()
    headers = {"Content-Type": "application/json"}
    sandbox.faults.add(path, service=source, status=status, times=None, body=body, headers=headers)
    settings = sandbox.settings() | {"KB_DATA": str(tmp_path / "data")}
    done = here(source, "crawl", "--limit", "1", env=settings)
    assert done.code in (1, 4), done.err
    assert done.said
    assert "unexpected" not in done.err
    assert "Traceback" not in done.err
