"""A plan counts and sends nothing."""

import pytest

from kb.reddit.plan import plan_refresh
from kb.store.lock import writer
from tests.reddit.work import LATER, Work


def test_a_plan_waits_for_no_writer(tiny: Work, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("KB_NOW", LATER)
    files = {path: path.stat().st_mtime_ns for path in tiny.root.rglob("*") if path.is_file()}
    with writer(tiny.root, "reddit"):
        planned = plan_refresh(tiny.run())
    del files[tiny.root / "state" / "reddit.lock"]
    assert planned["phases"][0]["items"] > 100
    assert {path: path.stat().st_mtime_ns for path in files} == files
