"""Where results go, and in which format."""

import io
import os
import subprocess
import sys
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import pyarrow.parquet as pq
import pytest

from tests.cli.conftest import clean_environment

SQL = (
    "SELECT 1 AS n, 'a, \"b\"' AS text, TIMESTAMPTZ '2026-11-20 12:00:00+00' AS at, [1.5,"
    " NULL] AS list, NULL AS nothing UNION ALL SELECT 2, 'é' || chr(10) || 'x', NULL,"
    " NULL, NULL ORDER BY n"
)


def test_parquet_to_a_pipe_and_to_a_file(kb: Any, tmp_path: Path) -> None:
    done = subprocess.run(
        [sys.executable, "-m", "kb", "query", SQL, "--format", "parquet"],
        cwd=tmp_path,
        env=clean_environment(),
        capture_output=True,
        check=True,
    )
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
