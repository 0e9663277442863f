"""Rows by verdict, against DuckDB over the same files."""

import html
import re
from pathlib import Path

import duckdb

from tests.explore.conftest import Explored, total


def cells(text: str) -> list[list[str]]:
    """The rows of a page's table."""
    body = text.partition("<tbody>")[2].partition("</tbody>")[0]
    return [
        [html.unescape(one) for one in re.findall(r"<td>(.*?)</td>", row, re.DOTALL)]
        for row in body.split("</tr>")[:-1]
    ]


def test_rejected_rows_by_stage_and_reason(demo_pages: Explored, demo: Path) -> None:
    files = f"{demo}/data/demo/clean/youtube/rejected/*.parquet"
    answer = demo_pages.ask("/rows?source=youtube&verdict=rejected&stage=views&reason=below")
    found = duckdb.sql(
        f"SELECT key, value, threshold FROM read_parquet('{files}')"
        " WHERE stage = 'views' AND reason = 'below'"
    ).fetchall()
    assert total(answer.text) == len(found) > 0
    shown = {(row[0], row[3], row[4]) for row in cells(answer.text)}
    assert shown == set(found)


def test_pages_are_fifty_rows_in_the_order_of_a_column(demo_pages: Explored, demo: Path) -> None:
    pattern = f"{demo}/data/demo/clean/reddit/comments/*.parquet"
    expected = duckdb.sql(
        f"SELECT score FROM read_parquet('{pattern}') ORDER BY score DESC LIMIT 100"
    ).fetchall()
    scores: list[int] = []
    for page in (1, 2):
        text = demo_pages.ask(
            f"/rows?source=reddit&table=comments&sort=score&descending=1&page={page}"
        ).text
        names = re.findall(r'<th scope="col".*?>([a-z_]+)</a></th>', text)
        rows = cells(text)
        assert len(rows) == 50
        scores += [int(row[names.index("score")]) for row in rows]
    assert scores == [score for (score,) in expected]


def test_text_is_looked_for_literally(demo_pages: Explored, demo: Path) -> None:
    pattern = f"{demo}/data/demo/clean/youtube/videos/*.parquet"
    ((found,),) = duckdb.sql(
        f"SELECT count(*) FROM read_parquet('{pattern}') WHERE title ILIKE '%iron sword%'"
    ).fetchall()
    answer = demo_pages.ask("/rows?source=youtube&text=IRON%20sword")
    assert total(answer.text) >= found > 0
    assert total(demo_pages.ask("/rows?source=youtube&text=%25%25%25").text) == 0


def test_what_a_release_lacks_is_empty_and_no_error(release_pages: Explored) -> None:
    answer = release_pages.ask("/rows?source=youtube&verdict=rejected")
    assert (answer.status, total(answer.text)) == (200, 0)
