"""A plan counts and sends nothing."""

from pathlib import Path
from typing import Any

import pytest

from kb.reddit.connector.plan import plan_refresh
from kb.sandbox.server import Sandbox
from kb.store.lock import writer
from tests.reddit.conftest import small_world
from tests.reddit.work import LATER, Work


@pytest.fixture
def tiny(tmp_path: Path) -> Any:
    """Each case once with small trees, crawled."""
    with Sandbox(small_world(24, width=12, depth=12), services=["reddit"]) as sandbox:
        work = Work(sandbox, tmp_path, listings=("new",), search=())
        work.crawl()
        yield work


def test_a_plan_waits_for_no_writer(tiny: Work, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("KB_NOW", LATER)
    files = {path: path.stat().st_mtime_ns for path in tiny.root.rglob("*") if path.is_file()}
    with writer(tiny.root, "reddit"):
        planned = plan_refresh(tiny.run())
    del files[tiny.root / "state" / "reddit.lock"]
    assert planned["phases"][0]["items"] > 100
    assert {path: path.stat().st_mtime_ns for path in files} == files
