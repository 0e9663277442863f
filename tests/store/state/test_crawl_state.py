"""Tests of `kb.store.state.crawl_state`."""

import contextlib
import shutil
import sqlite3

import pytest

from kb.core.errors import NewerVersion
from kb.store.state import frontier as module
from tests.store.state.test_frontier import open_frontier, plan_of


def as_version_1(root):
    """The state as the first version left it, killed before its log was folded in."""
    frontier = open_frontier(root)
    frontier._db.execute("DROP INDEX items_by_order")
    frontier._db.execute("DROP TABLE ledger")
    frontier._db.execute("DROP TABLE lost")
    frontier._db.execute(
        "CREATE TABLE ledger (id INTEGER PRIMARY KEY, at TEXT NOT NULL, day TEXT NOT NULL, bucket"
        " TEXT NOT NULL, units INTEGER NOT NULL, endpoint TEXT NOT NULL, outcome TEXT)"
    )
    frontier._db.execute(
        "INSERT INTO ledger VALUES (1, '2026-11-20T12:00:00Z', '2026-11-20', 'b', 5, 'list', '200')"
    )
    frontier._db.execute("PRAGMA user_version = 1")
    frontier.add_keys("video", ["c", ("a", {"channel": 1}), "b"])
    frontier.done("video", "c")
    state = root / "killed" / "state"
    state.mkdir(parents=True)
    for name in ("youtube.sqlite", "youtube.sqlite-wal"):
        shutil.copyfile(frontier.path.with_name(name), state / name)
    frontier.close()
    return root / "killed"


def test_an_older_state_is_migrated_after_a_backup(tmp_path):
    root = as_version_1(tmp_path)
    frontier = open_frontier(root)
    assert frontier._db.execute("PRAGMA user_version").fetchone() == (3,)
    assert frontier.requests() == (1, 5)
    assert "items_by_order" in plan_of(frontier, module.LAST, "video")
    assert [item.key for item in frontier.take("video", 9)] == ["a", "b"]
    # The backup is whole: also what was in the log only.
    backup = root / "state" / "youtube.sqlite.v1.bak"
    with contextlib.closing(sqlite3.connect(backup)) as old:
        assert old.execute("PRAGMA user_version").fetchone() == (1,)
        assert old.execute("SELECT key, status FROM items ORDER BY seq").fetchall() == [
            ("c", "done"),
            ("a", "todo"),
            ("b", "todo"),
        ]
    frontier.close()
    assert sorted(path.name for path in backup.parent.iterdir()) == [
        "youtube.sqlite",
        "youtube.sqlite.v1.bak",
        "youtube.sqlite.v2.bak",
    ]
    before = backup.stat().st_mtime_ns
    open_frontier(root).close()
    assert backup.stat().st_mtime_ns == before


def test_a_state_of_a_newer_version_is_left_alone(tmp_path):
    frontier = open_frontier(tmp_path)
    frontier._db.execute("PRAGMA user_version = 99")
    frontier.close()
    with pytest.raises(NewerVersion, match="newer Lorecrawl"):
        open_frontier(tmp_path)
