"""`kb query` as a user types it."""

import io
import json
import sys
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from kb.schema.tables import table
from tests.inprocess import Here


@pytest.fixture
def root(tmp_path: Path) -> Path:
    """A data root with two rejected videos."""
    folder = tmp_path / "data" / "clean" / "youtube" / "rejected"
    folder.mkdir(parents=True)
    schema = table("shared/rejected").arrow()
    rows = [
        {field.name: None for field in schema}
        | {"key": key, "stage": "views", "reason": "low", "value": value, "threshold": "100"}
        for key, value in (("dQw4w9WgXcQ", "7"), ("J---aiyznGQ", "99"))
    ]
    pq.write_table(
        pa.Table.from_pylist(
            rows, schema=pa.schema([field.with_nullable(True) for field in schema])
        ),
        folder / "part-0.parquet",
    )
    return tmp_path / "data"


def test_views_of_the_data_root(kb: Any, root: Path) -> None:
    assert kb(
        "query", "SELECT key, value::INT AS v FROM youtube_rejected ORDER BY v", "--format", "csv"
    ).stdout == ("key,v\ndQw4w9WgXcQ,7\nJ---aiyznGQ,99\n")
    (line,) = json.loads(kb("query", "--tables", "--format", "json").stdout)
    assert (line["schema"], line["view"], line["rows"]) == ("clean", "youtube_rejected", 2)


@pytest.mark.parametrize(
    ("sql", "words"),
    [
        ("SELECT keyy FROM youtube_rejected", ["keyy", '"key"']),
        ("FROM youtube_rejectd", ["youtube_rejectd", "youtube_rejected"]),
        ("SELEC 1", ["SELEC"]),
        ("SELECT 1; SELECT 2", ["2 statements"]),
        ("DROP VIEW clean.youtube_rejected", ["only read"]),
        ("COPY (SELECT 1) TO 'x.csv'", ["only read"]),
        ("SELECT 'x'::INT", ["x"]),
        (
            (
                "SELECT CASE WHEN range > 90000 THEN error('late') ELSE range::VARCHAR END AS"
                " x FROM range(100000)"
            ),
            ["late"],
        ),
        ("SELECT [DATE 'infinity'] AS x", ["column x", "x::VARCHAR"]),
    ],
)
def test_a_wrong_query_is_one_line_and_exit_2(
    kb: Any, root: Path, tmp_path: Path, sql: str, words: list[str]
) -> None:
    before = sorted(tmp_path.rglob("*"))
    answer = kb("query", sql)
    assert answer.returncode == 2
    assert answer.stdout == ""
    assert answer.stderr.count("\n") == 1
    for word in words:
        assert word in answer.stderr
    assert sorted(tmp_path.rglob("*")) == before


@pytest.mark.parametrize("format", ["csv", "json", "parquet"])
def test_a_mistake_in_a_late_row_is_one_line_and_exit_2(
    kb: Any, tmp_path: Path, format: str
) -> None:
    late = (
        "SELECT CASE WHEN range > 90000 THEN error('late') ELSE range::VARCHAR END AS x"
        " FROM range(100000)"
    )
    answer = kb("query", late, "--format", format, "--out", "answer")
    assert (answer.returncode, answer.stderr.count("\n")) == (2, 1)
    assert "Invalid Input Error: late" in answer.stderr
    assert list(tmp_path.iterdir()) == []


def test_limit_gives_the_first_rows(kb: Any, root: Path) -> None:
    answer = kb("query", "SELECT range AS n FROM range(50000)", "--limit", "2", "--format", "csv")
    assert (answer.returncode, answer.stdout) == (0, "n\n0\n1\n")
    assert json.loads(kb("query", "SELECT 1 AS n", "--limit", "2", "--json").stdout) == [{"n": 1}]


def test_a_damaged_file_is_named(kb: Any, root: Path) -> None:
    file = root / "clean" / "youtube" / "rejected" / "part-0.parquet"
    file.write_bytes(file.read_bytes()[:100])
    answer = kb("query", "FROM youtube_rejected")
    assert answer.returncode == 1
    assert f"{file} can't be read" in answer.stderr
    assert "run `kb youtube filter` again" in answer.stderr
    assert answer.stderr.count("\n") == 1


COMMENTED = "-- how many\n--\n/* of\nthem */ SELECT 7 AS n -- so many\n"


def test_sql_from_a_file_and_from_standard_input(
    kb: Any, here: Here, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "q.sql").write_text("\ufeff" + COMMENTED, encoding="utf-8")
    assert kb("query", "--file", "q.sql", "--format", "csv").stdout == "n\n7\n"
    for words in (["-"], ["--file", "-"]):
        monkeypatch.setattr(sys, "stdin", io.TextIOWrapper(io.BytesIO(COMMENTED.encode())))
        assert here("query", *words, "--format", "csv").out == "n\n7\n"


@pytest.mark.parametrize("sql", [COMMENTED, "-- one\nSELECT 7 AS n;", "--\nSELECT 7 AS n"])
def test_a_query_may_begin_with_comments(kb: Any, sql: str) -> None:
    answer = kb("query", sql, "--format", "csv")
    assert (answer.returncode, answer.stdout, answer.stderr) == (0, "n\n7\n", "")


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["SELECT 1", "--tables"], "exactly one of"),
        (["SELECT 1", "--file", "q.sql"], "exactly one of"),
        ([], "exactly one of"),
        (["--file", "q.sql"], "q.sql: No such file"),
        (["-- only a comment"], "is empty"),
        (["--talbes"], "--tables"),
    ],
)
def test_one_query_from_one_place(kb: Any, arguments: list[str], words: str) -> None:
    answer = kb("query", *arguments)
    assert (answer.returncode, answer.stderr.count("\n")) == (2, 1)
    assert words in answer.stderr


def test_after_the_demo_its_own_tables_are_named(kb: Any, root: Path, tmp_path: Path) -> None:
    root.rename(tmp_path / "demo")
    root.mkdir()
    (tmp_path / "demo").rename(root / "demo")
    for words in (["--tables"], ["FROM youtube_videos"]):
        said = kb("query", *words).stderr
        assert said.endswith("did you mean --data data/demo?\n")
    assert "youtube_rejected" in kb("query", "--data", "data/demo", "--tables").stdout
