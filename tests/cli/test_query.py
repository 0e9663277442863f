"""`kb query` as a user meets it; what the views hold is tested with kb.schema."""

from __future__ import annotations

import io
import json
import subprocess
import sys
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from kb.schema.tables import table
from tests.cli.conftest import clean_environment

SQL = (
    "SELECT 1 AS n, 'a, \"b\"' AS text, TIMESTAMPTZ '2026-11-20 12:00:00+00' AS at, [1.5, NULL] AS list, NULL AS nothing"
    " UNION ALL SELECT 2, 'é' || chr(10) || 'x', NULL, NULL, NULL ORDER BY n"
)


@pytest.fixture
def root(tmp_path: Path) -> Path:
    """A data root with two rejected videos."""
    folder = tmp_path / "data" / "clean" / "youtube" / "rejected"
    folder.mkdir(parents=True)
    schema = table("shared/rejected").arrow()
    rows = [
        {field.name: None for field in schema} | {"key": key, "stage": "views", "reason": "low", "value": value, "threshold": "100"}
        for key, value in (("dQw4w9WgXcQ", "7"), ("J---aiyznGQ", "99"))
    ]
    pq.write_table(pa.Table.from_pylist(rows, schema=pa.schema([field.with_nullable(True) for field in schema])), folder / "part-0.parquet")
    return tmp_path / "data"


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
    assert answer.stdout == 'n,text,at,list,nothing\n1,"a, ""b""",2026-11-20T12:00:00Z,"[1.5,null]",\n2,"é\nx",,,\n'


def test_json(kb: Any) -> None:
    answer = kb("query", SQL, "--format", "json")
    assert json.loads(answer.stdout) == [
        {"n": 1, "text": 'a, "b"', "at": "2026-11-20T12:00:00Z", "list": [1.5, None], "nothing": None},
        {"n": 2, "text": "é\nx", "at": None, "list": None, "nothing": None},
    ]
    assert kb("query", SQL, "--json").stdout == answer.stdout
    assert json.loads(kb("query", "SELECT 1 WHERE false", "--format", "json").stdout) == []


def test_parquet_to_a_pipe_and_to_a_file(kb: Any, tmp_path: Path) -> None:
    done = subprocess.run(
        [sys.executable, "-m", "kb", "query", SQL, "--format", "parquet"], cwd=tmp_path, env=clean_environment(), capture_output=True, check=True
    )
    piped = pq.read_table(io.BytesIO(done.stdout))
    assert piped["at"].to_pylist() == [datetime(2026, 11, 20, 12, tzinfo=UTC), None]
    assert kb("query", SQL, "--format", "parquet", "--out", "answer.parquet").returncode == 0
    assert pq.read_table(tmp_path / "answer.parquet").equals(piped)


def test_a_long_answer_is_cut_for_people_and_says_so(kb: Any) -> None:
    lines = kb("query", "SELECT range AS n FROM range(1234)").stdout.splitlines()
    assert lines[-1] == "... 1,234 rows in all; --format csv prints every one"
    assert len(lines) == 103
    assert len(kb("query", "SELECT range AS n FROM range(1234)", "--format", "csv").stdout.splitlines()) == 1235


def test_views_of_the_data_root(kb: Any, root: Path) -> None:
    assert kb("query", "SELECT key, value::INT AS v FROM youtube_rejected ORDER BY v", "--format", "csv").stdout == (
        "key,v\ndQw4w9WgXcQ,7\nJ---aiyznGQ,99\n"
    )
    (line,) = json.loads(kb("query", "--tables", "--format", "json").stdout)
    assert (line["schema"], line["view"], line["rows"]) == ("clean", "youtube_rejected", 2)


@pytest.mark.parametrize(
    ("sql", "words"),
    [
        ("SELECT keyy FROM youtube_rejected", ["keyy", '"key"']),
        ("FROM youtube_rejectd", ["youtube_rejectd", "youtube_rejected"]),
        ("SELEC 1", ["SELEC"]),
        ("SELECT 1; SELECT 2", ["2 statements"]),
        ("DROP VIEW clean.youtube_rejected", ["only reads"]),
        ("COPY (SELECT 1) TO 'x.csv'", ["only reads"]),
        ("SELECT 'x'::INT", ["x"]),
    ],
)
def test_a_wrong_query_is_one_line_and_exit_2(kb: Any, root: Path, tmp_path: Path, sql: str, words: list[str]) -> None:
    before = sorted(tmp_path.rglob("*"))
    answer = kb("query", sql)
    assert answer.returncode == 2
    assert answer.stdout == ""
    assert answer.stderr.count("\n") == 1
    for word in words:
        assert word in answer.stderr
    assert sorted(tmp_path.rglob("*")) == before


def test_a_damaged_file_is_named(kb: Any, root: Path) -> None:
    file = root / "clean" / "youtube" / "rejected" / "part-0.parquet"
    file.write_bytes(file.read_bytes()[:100])
    answer = kb("query", "FROM youtube_rejected")
    assert answer.returncode == 1
    assert "clean/youtube/rejected" in answer.stderr
    assert answer.stderr.count("\n") == 1
