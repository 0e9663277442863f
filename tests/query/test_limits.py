"""Time limits of queries."""

import threading
from pathlib import Path
from typing import Any

import duckdb

from kb.query.limits import Limits, limited


def test_a_query_that_does_not_end_is_ended(kb: Any, root: Path) -> None:
    endless = "SELECT count(*) FROM range(9999999) a, range(9999999) b WHERE a.range % 9 > b.range"
    answer = kb("query", endless, "--data", str(root), "--timeout", "0.5", "--out", "x.csv")
    assert answer.returncode == 1
    assert "the query took longer than 0.5 s; ask for less" in answer.stderr
    assert not (root.parent / "x.csv").exists()
    # The next one is not bound by what was left of the first.
    assert kb("query", "SELECT 1", "--data", str(root)).returncode == 0


def test_nothing_of_a_query_runs_on_when_it_has_answered() -> None:
    """A thread with the connection in its hands at the end of Python is told as leaked memory."""
    before = set(threading.enumerate())
    con = duckdb.connect()
    with limited(con, Limits(seconds=60, memory=1 << 30)):
        con.execute("SELECT 1").fetchall()
    assert set(threading.enumerate()) == before
