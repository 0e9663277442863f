"""Tests of `kb.store.state.crawl_state`."""

import shutil
import sqlite3
from pathlib import Path

import pytest

from kb.core.errors import DamagedData, FatalError
from kb.store.state.frontier import Frontier


@pytest.fixture
def state(tmp_path: Path) -> Path:
    path = tmp_path / "state" / "feed.sqlite"
    frontier = Frontier(path)
    frontier.add_keys("page", ["a"])
    frontier.set_cursor("round", 7)
    frontier.set_offset("page", "000001", 5)
    frontier.close()
    return path


@pytest.mark.parametrize(
    "sql",
    [
        "PRAGMA user_version = -1",
        "PRAGMA user_version = -2000000000",
        "DROP TABLE items",
        "DROP TABLE cursors",
        "DROP TABLE offsets",
        "UPDATE items SET payload = '{'",
        "UPDATE cursors SET value = 'seven'",
        "UPDATE cursors SET value = '[7]'",
        "UPDATE offsets SET offset = 'x'",
        "UPDATE offsets SET offset = -5",
    ],
)
def test_a_malformed_state_is_named_with_what_to_do(state: Path, sql: str) -> None:
    with sqlite3.connect(state) as db:
        db.execute(sql)
    db.close()
    with pytest.raises(DamagedData, match=f"the state {state} can't be read") as error:
        use(state)
    assert "move it away" in error.value.hint
    shutil.move(state, state.with_name("away"))  # the log beside it is left where it is
    use(state)


def use(path: Path) -> None:
    frontier = Frontier(path)
    try:
        frontier.take("page")
        frontier.cursor("round", 0)
        frontier.offsets()
    finally:
        frontier.close()


def test_a_log_whose_state_was_moved_away_fills_no_new_one(state: Path) -> None:
    frontier = Frontier(state)
    frontier.add_keys("page", ["b"])  # stands in the log as long as the file is open
    kept = state.with_name(f"{state.name}-wal").read_bytes()
    frontier.close()
    shutil.move(state, state.with_name("away"))
    state.with_name(f"{state.name}-wal").write_bytes(kept)
    fresh = Frontier(state)
    assert fresh.counts("page") == {}
    fresh.close()


def test_a_state_that_may_not_be_opened_is_no_damaged_one(tmp_path: Path) -> None:
    path = tmp_path / "feed.sqlite"
    path.mkdir()
    with pytest.raises(FatalError, match="can't be opened: it is a folder") as error:
        Frontier(path)
    assert "move" not in error.value.hint
    assert "read and write" in error.value.hint


def test_a_state_that_another_program_holds_says_so(state: Path) -> None:
    frontier = Frontier(state)
    frontier._db.execute("PRAGMA busy_timeout = 1")
    holder = sqlite3.connect(state, isolation_level=None)
    try:
        holder.execute("BEGIN IMMEDIATE")
        with pytest.raises(FatalError, match="can't be read: database is locked") as error:
            frontier.add_keys("page", ["c"])
        assert "try again in a moment" in error.value.hint
    finally:
        holder.close()
        frontier.close()
