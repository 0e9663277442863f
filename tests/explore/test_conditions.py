"""Conditions on columns: what the pages show is what DuckDB and a draw find by the copied text."""

import html
import re
import shlex
import shutil
from pathlib import Path
from typing import Any

import duckdb
import pyarrow.parquet as pq
import pytest

from kb.explore.conditions import TESTS, Condition, conditions, fields, sql_of
from kb.store.tables.shard_writer import write_table
from tests.explore.conftest import Explored, explored, number, total
from tests.inprocess import Here

KINDS = {"n": "BIGINT", "ok": "BOOLEAN", "word": "VARCHAR", "of": "ENUM('a')", "a b": "VARCHAR"}


@pytest.mark.parametrize(
    ("condition", "sql"),
    [
        (("n", "at least", "5"), "n >= 5"),
        (("n", "is not", "-1e3"), "n <> -1e3"),
        (("ok", "is", "Yes"), "ok = true"),
        (("word", "is", "it's"), "word = 'it''s'"),
        (("of", "is", "a"), "of::VARCHAR = 'a'"),
        (("a b", "is empty", ""), '"a b" IS NULL'),
        (("word", "is there", ""), "word IS NOT NULL"),
        (("word", "contains", "A'b%"), "contains(lower(word::VARCHAR), 'a''b%')"),
    ],
)
def test_a_condition_as_sql(condition: tuple[str, str, str], sql: str) -> None:
    given = [Condition(*condition)]
    assert sql_of(given, KINDS) == [sql]
    assert conditions(fields(given)) == given
    columns = ", ".join(f'NULL::{kind} AS "{name}"' for name, kind in KINDS.items())
    duckdb.sql(f"FROM (SELECT {columns}) WHERE {sql}")


@pytest.mark.parametrize(
    "query",
    [
        "column1=password&test1=is&value1=x",
        "column1=view_count&test1=is&value1=1 OR true",
        "column1=view_count&test1=is&value1=nan",
        "column1=view_count&test1=like&value1=1",
    ],
)
def test_what_is_no_condition_is_refused(demo_pages: Explored, query: str) -> None:
    answer = demo_pages.ask(f"/rows?source=youtube&{query.replace(' ', '%20')}")
    assert answer.status == 400
    assert "Traceback" not in answer.text


def test_rows_by_a_column_that_is_not_shown(demo_pages: Explored, demo: Path) -> None:
    pattern = f"{demo}/data/demo/clean/youtube/videos/*.parquet"
    where = "like_count >= 50 AND contains(lower(title), 'a')"
    ((found,),) = duckdb.sql(f"SELECT count(*) FROM '{pattern}' WHERE {where}").fetchall()
    query = (
        "column1=like_count&test1=at+least&value1=50&column2=title&test2=contains&value2=A"
        "&sort=like_count&descending=1"
    )
    text = demo_pages.ask(f"/rows?source=youtube&{query}").text
    assert total(text) == found > 0
    assert "Likes" in text
    last = demo_pages.ask(f"/rows?source=youtube&{query}&page=2").text
    assert total(last) == found


@pytest.fixture(scope="module")
def known(demo: Path, tmp_path_factory: pytest.TempPathFactory, make_rows: Any) -> Path:
    """A root with scores and labels of its first pairs."""
    root = tmp_path_factory.mktemp("known") / "data"
    shutil.copytree(demo / "data" / "demo", root)
    first = pq.read_table(next((root / "pairs").glob("pairs-*.parquet"))).slice(0, 20)
    ids, videos = first["pair_id"].to_pylist(), first["video_id"].to_pylist()
    scores = make_rows(
        "pairs/scores", 20, pair_id=ids, video_id=videos, similarity=[n / 20 for n in range(20)]
    )
    write_table(root / "pairs/scores-00000-of-00001.parquet", scores, "pairs/scores")
    labels = make_rows(
        "labels/labels",
        20,
        item_id=ids,
        video_id=videos,
        kind=["pair"] * 20,
        question=["visible"] * 20,
        answer=["yes", "no"] * 10,
    )
    write_table(root / "labels/labels-00000-of-00001.parquet", labels, "labels/labels")
    return root


def test_pairs_by_quality_scores_and_labels_and_the_same_draw(
    known: Path, tmp_path: Path, here: Here
) -> None:
    query = (
        "column1=similarity&test1=at+least&value1=0.25&column2=visible&test2=is&value2=yes"
        "&column3=words_per_second&test3=at+most&value3=100&sort=similarity&descending=1"
    )
    with explored(known, "--judge", "Anna") as pages:
        text = pages.ask(f"/pairs?{query}").text
        values = [float(n) for n in re.findall(r"Similarity \(.*?\) <b>([\d.]+)</b>", text)]
        assert values == sorted(values, reverse=True)
        found = number(re.findall(r"<p>([\d,]+) pairs", text)[0])
        assert found == len(values) == 7
        option = html.unescape(re.findall(r'<code id="where">(.*?)</code>', text)[0])
        judge = html.unescape(re.findall(r'href="(/judge\?[^"]*)"', text)[0])
        assert "of 7 judged" in re.sub(r"<.*?>", "", pages.ask(judge).text)
        assert pages.ask("/pairs?sort=similarity").status == 200
    words = ["pairs", "draw", "7", *shlex.split(option), "--out", tmp_path / "draw"]
    done = here(*words, "--data", str(known))
    assert done.code == 0, done.err
    assert pq.read_table(tmp_path / "draw" / "pairs.parquet").num_rows == found
    assert here(*words[:2], "8", *words[3:], "--data", str(known), "--plan").code == 2


def test_near_duplicates_stand_side_by_side(demo_pages: Explored, demo: Path) -> None:
    quality = f"{demo}/data/demo/pairs/quality-*.parquet"
    first, size = duckdb.sql(
        f"SELECT duplicate_of, cluster_size FROM '{quality}' WHERE duplicate_of IS NOT NULL"
        " ORDER BY ALL LIMIT 1"
    ).fetchall()[0]
    text = demo_pages.ask(f"/pairs?cluster={first}").text
    assert f"<p>{size:,} pairs that say nearly the same" in text
    assert text.count("<article") == size


def test_every_test_can_be_asked_of_every_column(known: Path) -> None:
    with explored(known) as pages:
        text = pages.ask("/pairs").text
        names = re.findall(r"<option>(\w+)</option>", text.partition('name="column1"')[2])
        columns = list(dict.fromkeys(name for name in names if name not in TESTS))
        assert {"similarity", "visible", "has_verb", "cluster_size"} <= {*columns}
        assert pages.ask(f"/pairs?column1={columns[0]}&test1=is+there").status == 200
