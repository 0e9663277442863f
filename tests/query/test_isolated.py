"""Tests of queries in a process of their own."""

from pathlib import Path

import pytest

from kb.core.errors import FatalError, UsageError
from kb.query.isolated import QueryReply, run_isolated
from kb.query.limits import Limits


def ask(sql: str, *, seconds: float = 30, **given: int) -> QueryReply:
    bounds = {"rows": 10, "characters": 1000, "cell": 100, **given}
    limits = Limits(seconds=seconds, memory=1 << 30, threads=2)
    return run_isolated(sql, [], limits=limits, **bounds)


def test_rows_and_characters_are_bounded() -> None:
    reply = ask("FROM range(100)", rows=3)
    assert (reply.lines, reply.more) == (["range\n", "0\n", "1\n", "2\n"], True)
    assert ask("SELECT 7 AS n") == QueryReply(["n\n", "7\n"])
    reply = ask("SELECT repeat('x', 900) AS text FROM range(3)", cell=900, characters=1000)
    assert (len(reply.lines), reply.more) == (2, True)


@pytest.mark.parametrize(
    ("sql", "error"),
    [
        ("SELECT nonsense", UsageError),
        ("COPY (SELECT 1) TO 'there.csv'", UsageError),
        ("SELECT count(*) FROM range(9999999) a, range(9999999) b WHERE a.range % 9 > b.range",
         FatalError),
    ],
)  # fmt: skip
def test_errors_keep_their_class(
    sql: str, error: type[Exception], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(error):
        ask(sql, seconds=0.5)
    assert not list(tmp_path.iterdir())
