"""Rows by verdict, against DuckDB over the same files."""

import html
import json
import re
import shutil
from pathlib import Path
from urllib.parse import quote

import duckdb
import pyarrow.parquet as pq
import pytest

from kb.core.sources import SOURCES
from kb.explore.pairs import ON_A_PAGE
from tests import processes
from tests.cli.conftest import clean_environment
from tests.explore.conftest import Explored, explored, number, total


def cells(text: str) -> list[list[str]]:
    """The rows of a page's table."""
    body = text.partition("<tbody>")[2].partition("</tbody>")[0]
    return [
        [
            html.unescape(re.sub(r"<.*?>", "", one))
            for one in re.findall(r"<td.*?>(.*?)</td>", row, re.DOTALL)
        ]
        for row in body.split("</tr>")[:-1]
    ]


def headings(text: str) -> list[str]:
    return re.findall(r'<th scope="col".*?><a.*?>(.*?)</a></th>', text)


def test_rejected_rows_by_stage_and_reason(demo_pages: Explored, demo: Path) -> None:
    files = f"{demo}/data/demo/clean/youtube/rejected/*.parquet"
    answer = demo_pages.ask("/rows?source=youtube&verdict=rejected&stage=views&reason=below")
    found = duckdb.sql(
        f"SELECT key, value, threshold FROM read_parquet('{files}')"
        " WHERE stage = 'views' AND reason = 'below'"
    ).fetchall()
    assert total(answer.text) == len(found) > 0
    names, rows = headings(answer.text), cells(answer.text)
    shown = {(row[-1], row[names.index("Value")], row[names.index("Threshold")]) for row in rows}
    assert shown == {(key, f"{int(value):,}", f"{int(limit):,}") for key, value, limit in found}


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
        rows, place = cells(text), headings(text).index("Score")
        assert len(rows) == 50
        scores += [number(row[place]) for row in rows]
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


def test_a_row_that_is_gone_disappears_from_the_next_page(demo: Path, tmp_path: Path) -> None:
    root = tmp_path / "root"
    for name in ("clean/youtube", "state"):
        shutil.copytree(demo / "data" / "demo" / name, root / name)
    with explored(root) as pages:
        before = total(pages.ask("/rows?source=youtube").text)
        folder = root / "clean" / "youtube"
        (folder / "_manifest.json").unlink()
        part = next(iter((folder / "videos").glob("*.parquet")))
        rows = pq.read_table(part)
        pq.write_table(rows.slice(1), part)
        assert total(pages.ask("/rows?source=youtube").text) == before - 1


def test_pages_are_read_while_a_filter_replaces_the_tables(demo: Path, tmp_path: Path) -> None:
    root = tmp_path / "root"
    shutil.copytree(demo / "data" / "demo", root)
    paths = ("/", "/rows?source=wiki", "/thresholds?source=wiki&value=5", "/status")
    with explored(root) as pages:
        words = ("wiki", "filter", "--quiet", "--data", root)
        for _ in range(2):
            process = processes.start(words, env=clean_environment(), cwd=tmp_path)
            while process.poll() is None:
                assert [pages.ask(path).status for path in paths] == [200] * len(paths)
            assert process.returncode == 0


def test_rows_by_verdict_and_stage_are_the_filters(demo_pages: Explored, demo: Path) -> None:
    text = demo_pages.ask("/").text
    for source in ("youtube", "wiki", "reddit"):
        path = demo / "data" / "demo" / "clean" / source / "summary.json"
        summary = json.loads(path.read_text())
        section = text.partition(f'id="of-{source}"')[2].partition("</section>")[0]
        shown = {
            verdict: int(n.replace(",", ""))
            for n, verdict in re.findall(r">([\d,]+) (kept|rejected|failed|pending)<", section)
        }
        assert shown == {
            verdict: sum(one[verdict] for one in summary["tally"].values()) for verdict in shown
        }
        dropped = re.findall(r'stage=(\w+)" .*?>−([\d,]+)<', section)
        assert {stage: int(n.replace(",", "")) for stage, n in dropped} == summary["stages"]
        last = re.findall(r'<span class="n">([\d,]+) ', section)[-1]
        assert int(last.replace(",", "")) == shown["kept"]


def test_pairs_of_a_keyword_in_the_order_of_the_video(demo_pages: Explored, demo: Path) -> None:
    root = demo / "data" / "demo" / "pairs"
    pairs = f"read_parquet('{root}/pairs-*.parquet')"
    ((keyword, count),) = duckdb.sql(
        f"SELECT keyword, count(*) AS n FROM {pairs} GROUP BY ALL HAVING n > {ON_A_PAGE}"
        " ORDER BY ALL LIMIT 1"
    ).fetchall()
    expected = duckdb.execute(
        f"""SELECT video_id, floor(clip_start_s)::BIGINT FROM {pairs}
        WHERE keyword = ? ORDER BY video_id, clip_start_s, pair_id""",
        [keyword],
    ).fetchall()
    pages = -(-count // ON_A_PAGE)
    found: list[tuple[str, int]] = []
    for page in range(1, pages + 1):
        text = demo_pages.ask(f"/pairs?keyword={quote(keyword)}&page={page}").text
        found += [
            (video, int(start))
            for video, start in re.findall(r"watch\?v=([\w-]+)&amp;t=(\d+)s", text)
        ]
    assert found == expected
    assert f"<p>{len(expected):,} pairs.</p>" in text
    assert re.search(r'<span class="mark" title="Language">en</span>', text)


def test_a_release_says_that_it_has_no_text(release_pages: Explored) -> None:
    text = release_pages.ask("/pairs?keyword=creeper").text
    assert "The text was not restored" in text
    assert 'rel="noopener noreferrer" target="_blank"' in text


def test_a_rejected_row_says_what_it_was_unless_that_was_taken_down(
    demo_pages: Explored, demo: Path
) -> None:
    files = f"{demo}/data/demo/clean/reddit/rejected/*.parquet"
    withheld = duckdb.sql(
        f"SELECT count(*), count(title), count(text) FROM read_parquet('{files}')"
        " WHERE stage = 'removed'"
    ).fetchall()
    assert withheld[0][0] > 0
    assert withheld[0][1:] == (0, 0)
    ((key, text, post),) = duckdb.sql(
        f"SELECT key, text, post_id FROM read_parquet('{files}')"
        " WHERE stage = 'toxicity' AND starts_with(key, 't1_') ORDER BY key LIMIT 1"
    ).fetchall()
    rows = demo_pages.ask("/rows?source=reddit&verdict=rejected&stage=toxicity&sort=key").text
    assert f'<a href="/document?ref=reddit%3A{key}">{html.escape(text)}</a>' in rows
    thread = demo_pages.ask(f"/document?ref=reddit:{key}").text
    here = thread.partition('id="here"')[2].partition("</li>")[0]
    assert html.escape(text) in here
    assert "toxicity" in here
    assert f"https://www.reddit.com/comments/{post}/" in thread


@pytest.mark.parametrize("source", ["youtube", "wiki", "reddit"])
@pytest.mark.parametrize("verdict", ["kept", "rejected"])
def test_every_row_leads_to_its_own_page(demo_pages: Explored, source: str, verdict: str) -> None:
    for table in SOURCES[source].tables if verdict == "kept" else ("",):
        text = demo_pages.ask(f"/rows?source={source}&verdict={verdict}&table={table}").text
        links = re.findall(r'href="(/document\?ref=[^"]*)"', text)
        assert len(links) == len(cells(text))
        assert {demo_pages.ask(html.unescape(link)).status for link in links[::17]} <= {200}
