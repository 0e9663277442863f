"""Results as tables, CSV, JSON and on a terminal."""

import contextlib
import csv
import io
import json
import os
import pty
import subprocess
import sys
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import duckdb
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from tests.cli.conftest import clean_environment

SQL = (
    "SELECT 1 AS n, 'a, \"b\"' AS text, TIMESTAMPTZ '2026-11-20 12:00:00+00' AS at, [1.5,"
    " NULL] AS list, NULL AS nothing UNION ALL SELECT 2, 'é' || chr(10) || 'x', NULL,"
    " NULL, NULL ORDER BY n"
)


def test_a_table_for_people(kb: Any) -> None:
    answer = kb("query", SQL)
    assert (answer.returncode, answer.stderr) == (0, "")
    assert answer.stdout.splitlines() == [
        "n  text    at                    list        nothing",
        "-  ------  --------------------  ----------  -------",
        '1  a, "b"  2026-11-20T12:00:00Z  [1.5,null]',
        "2  é x",
    ]


def test_csv(kb: Any) -> None:
    answer = kb("query", SQL, "--format", "csv")
    assert (
        answer.stdout
        == 'n,text,at,list,nothing\n1,"a, ""b""",2026-11-20T12:00:00Z,"[1.5,null]",\n2,"é\nx",,,\n'
    )


def test_json(kb: Any) -> None:
    answer = kb("query", SQL, "--format", "json")
    assert json.loads(answer.stdout) == [
        {
            "n": 1,
            "text": 'a, "b"',
            "at": "2026-11-20T12:00:00Z",
            "list": [1.5, None],
            "nothing": None,
        },
        {"n": 2, "text": "é\nx", "at": None, "list": None, "nothing": None},
    ]
    assert kb("query", SQL, "--json").stdout == answer.stdout
    assert json.loads(kb("query", "SELECT 1 WHERE false", "--format", "json").stdout) == []


def test_a_long_answer_is_cut_for_people_and_says_so(kb: Any) -> None:
    lines = kb("query", "SELECT range AS n FROM range(1234)").stdout.splitlines()
    assert lines[-1] == "... 1,234 rows in total; --format csv prints all of them"
    assert len(lines) == 103
    assert (
        len(
            kb("query", "SELECT range AS n FROM range(1234)", "--format", "csv").stdout.splitlines()
        )
        == 1235
    )


def test_columns_of_one_name_are_all_there(kb: Any, tmp_path: Path) -> None:
    sql = "SELECT 1 AS a, 2 AS a, 3 AS a_1 UNION ALL SELECT 4, 5, 6"
    assert (
        kb("query", sql, "--format", "json").stdout
        == '[{"a":1,"a_1":2,"a_1_1":3},{"a":4,"a_1":5,"a_1_1":6}]\n'
    )
    assert kb("query", sql, "--format", "csv").stdout == "a,a_1,a_1_1\n1,2,3\n4,5,6\n"
    kb("query", sql, "--format", "parquet", "--out", "answer.parquet")
    assert pq.read_table(tmp_path / "answer.parquet").to_pylist()[0] == {
        "a": 1,
        "a_1": 2,
        "a_1_1": 3,
    }


# What Python, JSON or Arrow have no value for.
ODD = (
    "SELECT INTERVAL 3 DAY AS i, 170141183460469231731687303715884105727::HUGEINT AS h,"
    " 'ab'::BLOB AS b, true AS yes, {'x y': [INTERVAL 1 DAY]} AS s,"
    " TIMESTAMP_NS '2026-01-02 03:04:05.123456789' AS n"
)


def test_values_of_every_kind(kb: Any, tmp_path: Path) -> None:
    (row,) = json.loads(kb("query", ODD, "--format", "json").stdout)
    assert row == {
        "i": "3 days",
        "h": 2**127 - 1,
        "b": "ab",
        "yes": True,
        "s": "{'x y': [1 day]}",
        "n": "2026-01-02T03:04:05.123456789",
    }
    assert kb("query", ODD, "--out", "answer.parquet").returncode == 0
    (row,) = duckdb.sql(f"SELECT i, h, b, s FROM '{tmp_path}/answer.parquet'").fetchall()
    assert row == ("3 days", 2**127 - 1, b"ab", "{'x y': [1 day]}")


def test_numbers_in_full(kb: Any) -> None:
    answer = kb(
        "query",
        "SELECT avg(x) AS mean, 0.12::FLOAT AS score, 1e16 AS big, 1e-7 AS small,"
        " 12.0::DOUBLE AS whole, 123456789012345678901234567890::HUGEINT AS huge, 1e300 AS vast,"
        " 'nan'::DOUBLE AS nothing FROM (VALUES (274100.0::DOUBLE), (274123.456789)) t(x)",
    )
    assert answer.stdout.splitlines()[2].split() == [
        "274111.7283945",
        "0.12",
        "10000000000000000",
        "0.0000001",
        "12.0",
        "123456789012345678901234567890",
        "1e+300",
        "nan",
    ]


# What a title may hold: a new window title, another colour by one C1 byte, text turned round,
# a forged line, and half a character.
HOSTILE = "a\x1b]0;owned\x07\x9b31m\u202eb\r\nkb: done\u2028c\u2066"


_BAD = set(HOSTILE) - set("a]0;owned31mbkb: donec\n")


@pytest.fixture
def hostile(tmp_path: Path) -> Path:
    """A data root whose one pending row has a hostile key."""
    folder = tmp_path / "data" / "clean" / "youtube" / "pending"
    folder.mkdir(parents=True)
    pq.write_table(pa.table({"key": [HOSTILE], "reason": ["label"]}), folder / "part-0.parquet")
    return tmp_path / "data"


def test_nothing_of_the_data_acts_on_the_terminal(kb: Any, hostile: Path) -> None:
    for sql in (
        "FROM youtube_pending",
        "SELECT [{'k': key}] AS list FROM youtube_pending",
        "PIVOT youtube_pending ON key USING count(*) GROUP BY reason",
        "SELECT error(key) FROM youtube_pending",
        "SELECT (SELECT key FROM youtube_pending)::INT",
    ):
        answer = kb("query", sql)
        said = answer.stdout + answer.stderr
        assert not _BAD & set(said), sql
        assert "\\x1b]0;owned" in said or "\\u001b]0;owned" in said, sql
        assert "\nkb: done" not in said, sql


def test_files_hold_the_data_as_it_is(kb: Any, hostile: Path, tmp_path: Path) -> None:
    for name in ("x.parquet", "x.json", "x.csv"):
        assert kb("query", "SELECT key FROM youtube_pending", "--out", name).returncode == 0
    assert pq.read_table(tmp_path / "x.parquet")["key"].to_pylist() == [HOSTILE]
    assert json.loads((tmp_path / "x.json").read_text()) == [{"key": HOSTILE}]
    with (tmp_path / "x.csv").open(newline="", encoding="utf-8") as file:
        assert list(csv.reader(file)) == [["key"], [HOSTILE]]


def on_a_terminal(tmp_path: Path, width: int, *arguments: str) -> str:
    """What a terminal that is so wide gets of `kb query`."""
    ours, theirs = pty.openpty()
    process = subprocess.Popen(
        [sys.executable, "-m", "kb", "query", *arguments],
        stdin=subprocess.DEVNULL,
        stdout=theirs,
        stderr=theirs,
        cwd=tmp_path,
        env={**clean_environment(), "COLUMNS": str(width), "TERM": "xterm"},
    )
    os.close(theirs)
    seen = b""
    with contextlib.suppress(OSError):  # Linux answers EIO when the other side is closed
        while chunk := os.read(ours, 65536):
            seen += chunk
    os.close(ours)
    assert process.wait() == 0, seen
    return seen.decode()


def test_a_terminal_gets_a_box_of_its_width(tmp_path: Path) -> None:
    wide = ", ".join(f"'{letter * 30}' AS {letter}" for letter in "abcdefgh")
    seen = on_a_terminal(tmp_path, 90, f"SELECT 274123.456789::DOUBLE AS mean, {wide}")
    lines = [line.rstrip() for line in seen.splitlines()]
    assert lines[0].startswith("┌")
    assert max(map(len, lines)) <= 90
    assert "274123.456789" in seen
    assert "9 columns" in lines[-1]
    long = on_a_terminal(tmp_path, 70, "SELECT range AS n FROM range(1234)")
    assert "1,234 rows in total" in long


def test_a_terminal_s_box_is_safe_and_says_utc(hostile: Path, tmp_path: Path) -> None:
    sql = (
        "SELECT key, [key] AS list, TIMESTAMPTZ '2026-11-20 12:00:00+02' AS at FROM youtube_pending"
    )
    seen = on_a_terminal(tmp_path, 200, sql)
    assert not (_BAD - {"\r"}) & set(seen)
    assert "\\x1b]0;owned" in seen
    assert "2026-11-20T10:00:00Z" in seen


def test_parquet_to_a_pipe_and_to_a_file(kb: Any, tmp_path: Path) -> None:
    done = subprocess.run(
        [sys.executable, "-m", "kb", "query", SQL, "--format", "parquet"],
        cwd=tmp_path,
        env=clean_environment() | {"PYTHONPROFILEIMPORTTIME": "1"},
        capture_output=True,
        check=True,
    )
    assert b" duckdb\n" in done.stderr
    assert b"pandas.core" not in done.stderr  # a third of a second before each answer
    piped = pq.read_table(io.BytesIO(done.stdout))
    assert piped["at"].to_pylist() == [datetime(2026, 11, 20, 12, tzinfo=UTC), None]
    assert kb("query", SQL, "--out", "answer.parquet").returncode == 0
    assert pq.read_table(tmp_path / "answer.parquet").equals(piped)


def test_out_names_a_file_a_link_or_a_pipe(kb: Any, tmp_path: Path) -> None:
    (tmp_path / "folder").mkdir()
    answer = kb("query", "SELECT 1 AS n", "--out", "folder")
    assert (answer.returncode, answer.stderr) == (
        2,
        "kb: --out folder is a folder; name a file in it\n",
    )
    (tmp_path / "link").symlink_to("there.csv")
    (tmp_path / "there.csv").touch()
    assert kb("query", "SELECT 1 AS n", "--out", "link", "--format", "csv").returncode == 0
    assert (tmp_path / "there.csv").read_text() == "n\n1\n"
    assert (tmp_path / "link").is_symlink()
    os.mkfifo(tmp_path / "pipe")
    with subprocess.Popen(["cat", "pipe"], cwd=tmp_path, stdout=subprocess.PIPE, text=True) as cat:
        assert kb("query", "SELECT 2 AS n", "--out", "pipe", "--format", "csv").returncode == 0
        assert cat.communicate()[0] == "n\n2\n"
    assert (tmp_path / "pipe").is_fifo()


WRITTEN = {
    "x.csv": "n\n1\n2\n",
    "x.json": '[{"n":1},{"n":2}]\n',
    "x.ndjson": '{"n":1}\n{"n":2}\n',
    "x.JSONL": '{"n":1}\n{"n":2}\n',
    "x.txt": "n\n-\n1\n2\n",
}


@pytest.mark.parametrize("name", WRITTEN)
def test_the_suffix_of_out_says_the_format(kb: Any, tmp_path: Path, name: str) -> None:
    assert kb("query", "FROM (VALUES (1), (2)) t(n)", "--out", name).returncode == 0
    assert (tmp_path / name).read_text() == WRITTEN[name]


def test_a_format_that_is_named_wins_over_the_suffix(kb: Any, tmp_path: Path) -> None:
    assert kb("query", "SELECT 1 AS n", "--format", "csv", "--out", "x.txt").returncode == 0
    assert (tmp_path / "x.txt").read_text() == "n\n1\n"
    assert kb("query", "SELECT 1 AS n", "--json", "--out", "x.csv").returncode == 0
    assert (tmp_path / "x.csv").read_text() == '[{"n":1}]\n'


@pytest.mark.parametrize(
    ("out", "words"),
    [
        ("answer", [".csv .json .ndjson .jsonl .parquet .txt", "--format"]),
        ("answer.xlsx", [".csv .json .ndjson .jsonl .parquet .txt", "--format"]),
        ("nowhere/x.csv", ["there is no folder", "nowhere"]),
    ],
)
def test_where_out_can_t_be_written_is_told_before_the_query_runs(
    kb: Any, tmp_path: Path, out: str, words: list[str]
) -> None:
    answer = kb("query", "SELECT error('it ran')", "--out", out)
    assert (answer.returncode, answer.stderr.count("\n")) == (2, 1)
    assert "it ran" not in answer.stderr
    for word in words:
        assert word in answer.stderr
    assert list(tmp_path.iterdir()) == []
