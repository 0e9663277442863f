"""Damaged files are named, whatever part of a query meets them."""

import threading
from pathlib import Path
from typing import Any

import duckdb
import pytest

from kb import query
from kb.artifacts import manifest
from kb.core.errors import DamagedData, FatalError, UsageError
from kb.query.execute import QueryReply, run_isolated
from kb.query.limits import Limits, limited
from tests.query.conftest import rows


def test_pages_that_are_broken_name_their_file_also_while_rows_stream(root: Path) -> None:
    file = root / "clean/youtube/videos/part-00001.parquet"
    data = bytearray(file.read_bytes())
    data[4:200] = b"\xff" * 196
    file.write_bytes(data)
    with (
        query.connect(root) as con,
        pytest.raises(DamagedData, match=r"part-00001\.parquet can't be read"),
    ):
        query.select(con, "FROM clean.youtube_videos", root=root).read_all()


@pytest.mark.parametrize(
    "sql",
    [
        "SELECT count(*) FROM clean.youtube_videos",
        "SELECT max(title) FROM Youtube_Videos",
        "SUMMARIZE youtube_videos",
    ],
)
def test_a_changed_bit_never_changes_an_answer(root: Path, sql: str) -> None:
    path = next(root.glob("clean/youtube/videos/*.parquet"))
    whole = manifest.describe("clean/youtube", root / "clean/youtube", manifest.Build(root, {}, {}))
    manifest.write_manifest(root / "clean/youtube/_manifest.json", whole)
    with query.connect(root) as con:
        query.select(con, sql, root=root).read_all()
    data = bytearray(path.read_bytes())
    data[len(data) // 3] ^= 1
    path.write_bytes(data)
    with query.connect(root) as con:
        query.select(con, "FROM release.youtube_videos", root=root).read_all()  # another's files
        with pytest.raises(DamagedData, match=f"{path.name} can't be read: checksum mismatch"):
            query.select(con, sql, root=root).read_all()


@pytest.mark.parametrize(
    ("sql", "said", "hint"),
    [
        (
            "SELECT titel FROM youtube_videos",
            'Referenced column "titel" not found in FROM clause! Candidate bindings: "title"',
            "--tables",
        ),
        (
            "SELECT * FROM youtube_video",
            "Table with name youtube_video does not exist! Did you mean youtube_videos?",
            "--tables",
        ),
        (
            "SELECT * FROM wiki_pages",
            "Table with name wiki_pages does not exist!",
            "`kb wiki crawl`, then `kb wiki filter`",
        ),
        ("SELEC 1", 'syntax error at or near "SELEC"', "--tables"),
        ("", "is empty", ""),
        ("SELECT 1; SELECT 2", "2 statements", ""),
        ("SELECT 'x'::INT", "Could not convert string 'x' to INT32", ""),
    ],
)
def test_a_mistake_is_one_line_with_a_hint(root: Path, sql: str, said: str, hint: str) -> None:
    with pytest.raises(UsageError) as caught:
        rows(root, sql)
    assert said in str(caught.value)
    assert "\n" not in str(caught.value)
    assert hint in caught.value.hint


@pytest.mark.parametrize(
    ("sql", "guess", "never"),
    [
        ("FROM youtube_vidoes", "Did you mean youtube_videos", "pairs"),
        ("FROM relase.youtube_videos", "release.youtube_videos", "rejected"),
        ("FROM release.youtube_vidoes", "Did you mean release.youtube_videos", "reddit"),
        ("SELECT v.titel FROM youtube_videos v", "Did you mean title", "width"),
        ("SELECT titel FROM youtube_videos", 'Candidate bindings: "title"', "width"),
    ],
)
def test_an_unknown_name_is_told_with_the_nearest_alone(
    root: Path, sql: str, guess: str, never: str
) -> None:
    with pytest.raises(UsageError) as caught:
        rows(root, sql)
    said = f"{caught.value}; {caught.value.hint}"
    assert guess in said
    assert never not in said
    assert len(said) < 250


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
