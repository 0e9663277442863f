"""`kb pairs` as a user runs it."""

import json
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Any

import duckdb
import pyarrow.parquet as pq
import pytest

from kb.core.sources import PUBLISHED
from kb.youtube.crawl.ids import RULES
from tests import processes
from tests.cli.conftest import clean_environment
from tests.pairs.made import fill, shards, tables


@pytest.fixture(scope="module")
def root(tmp_path_factory, make_rows) -> Path:
    root = tmp_path_factory.mktemp("cli") / "data"
    fill(root, *tables(40, 300, ["creeper", "oak log", "bed"], share=0.05), make_rows)
    return root


def kb(root: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    words = [*arguments, "--data", str(root), "--quiet"]
    return processes.run(words, env=clean_environment(), cwd=root.parent, timeout=120)


def test_pairs_from_the_shell(root: Path) -> None:
    done = kb(root, "pairs", "--json", "--workers", "2")
    assert done.returncode == 0, done.stderr
    summary = json.loads(done.stdout.splitlines()[-1])
    assert summary["videos"] == 40
    assert (
        summary["pairs"]
        == pq.read_table(shards(root / "pairs")).num_rows
        == pq.read_table(shards(root / "release" / "pairs")).num_rows
    )
    with duckdb.connect() as con:
        con.execute(f"CREATE VIEW pairs AS FROM '{root}/pairs/pairs-*.parquet'")
        shown = {
            noun: con.execute(f"SELECT {sql} FROM pairs").fetchone()
            for noun, _, sql in PUBLISHED["pairs"].totals
        }
    assert shown == {  # the report's figures
        "video-text pairs": (summary["pairs"],),
        "keywords in them": (summary["keywords_in_pairs"],),
    }
    assert summary["keywords_in_pairs"] <= summary["keywords_found"]
    draw = ("pairs", "draw", "3", "--max-videos", "1", "--out", "there")
    planned = processes.run(
        [*draw, "--plan", "--data", str(root)],
        env=clean_environment(),
        cwd=root.parent,
        timeout=120,
    )
    assert planned.returncode == 0, planned.stderr
    assert "no pairs for validation and test: a channel" in planned.stderr
    assert not (root.parent / "there").exists()
    whole = (root / "pairs" / "pairs-00000-of-00001.parquet").read_bytes()
    filled = kb(
        root,
        "pairs",
        "--from-index",
        str(root / "release" / "pairs" / "pairs-00000-of-00001.parquet"),
    )
    assert filled.returncode == 0, filled.stderr
    assert (root / "pairs" / "pairs-00000-of-00001.parquet").read_bytes() == whole
    wrong = kb(root, "pairs", "--from-index", "x.parquet", "--format", "minedojo")
    assert wrong.returncode == 2


def test_keywords_from_the_shell(root: Path) -> None:
    shown = kb(root, "pairs", "keywords", "--examples", "1")
    assert shown.returncode == 0, shown.stderr
    lines = shown.stdout.splitlines()
    assert lines[0] == "keyword\tkind\trule\tmatches\talone"
    names = [line.split("\t")[0] for line in lines[1:] if "\t" in line]
    assert set(names) >= {"Creeper", "Oak Log", "Bed"}
    assert "[creeper]" in shown.stdout


def test_nothing_to_read(tmp_path: Path) -> None:
    (tmp_path / "data" / "state").mkdir(parents=True)
    empty = kb(tmp_path / "data", "pairs")
    assert empty.returncode == 1
    here = f"--data {tmp_path / 'data'}"
    assert f"run `kb youtube crawl {here}`, then `kb youtube filter {here}`, then" in empty.stderr
    assert [path.name for path in (tmp_path / "data").iterdir()] == ["state"]


def test_an_index_without_transcripts_says_that_its_videos_come_first(
    make_rows: Callable[..., Any], tmp_path: Path
) -> None:
    released = tmp_path / "released"
    fill(released, *tables(4, 300, ["creeper"], share=0.05), make_rows)
    assert kb(released, "pairs").returncode == 0
    index = released / "release" / "pairs" / "pairs-00000-of-00001.parquet"
    (tmp_path / "data" / "state").mkdir(parents=True)
    empty = kb(tmp_path / "data", "pairs", "--from-index", str(index))
    assert empty.returncode == 1
    here = f"--data {tmp_path / 'data'}"
    assert f"run `kb youtube crawl --ids {index} {here}`, then `kb youtube filter" in empty.stderr
    listed = RULES.ids_in(index)  # and a crawl takes what is advised
    assert listed.keys
    assert listed.bad_lines == 0


def test_a_refill_takes_no_limit(root: Path) -> None:
    answer = kb(root, "pairs", "--from-index", "x.parquet", "--again")
    assert answer.returncode == 2
    assert "--from-index" in answer.stderr
