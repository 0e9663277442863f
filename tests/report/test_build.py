"""`kb report` over made data: every figure, the same bytes twice, and what is missing."""

import dataclasses
import json
import re
import shutil
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import duckdb
import pytest

from kb.cli.commands.overview import overview as facts
from kb.core.errors import FatalError
from kb.core.sources import BY_DEFAULT
from kb.explore import overview
from kb.explore.tables import CurrentTables
from kb.look import charts
from kb.schema import table
from kb.store.state import demo_mark
from kb.store.state.frontier import Frontier
from kb.store.tables.shard_writer import write_table
from tests.recipes import report
from tests.release.made import build
from tests.report.made import OfOne, a_run

FIGURES = {
    "youtube-videos-funnel",
    "youtube-durations",
    "youtube-views",
    "youtube-dates",
    "youtube-channels",
    "youtube-transcripts",
    "youtube-videos-toxicity",
    "youtube-words",
    "wiki-page",
    "wiki-page-overview",
    "wiki-page-overview-2",
    "wiki-page-overview-3",
    "wiki-page-overview-4",
    "wiki-dates",
    "wiki-pages-toxicity",
    "wiki-pages-funnel",
    "wiki-elements",
    "reddit-posts-funnel",
    "reddit-types",
    "reddit-scores",
    "reddit-comments-funnel",
    "reddit-dates",
    "reddit-posts-toxicity",
    "reddit-comments-toxicity",
    "reddit-words",
    "reddit-thread",
    "pairs-keywords",
    "pairs-lengths",
    "pairs-quality",
    "tasks-titles",
    "links-named",
    "links-known",
    "quota",
}


def test_every_figure_is_there_as_svg_png_and_pdf(root: Path) -> None:
    folder = root / "report"
    for suffix in ("svg", "png", "pdf"):
        assert {path.stem for path in folder.glob(f"*.{suffix}")} == FIGURES
    for path in folder.glob("*.pdf"):
        content = path.read_bytes()
        assert content.startswith(b"%PDF-")
        assert b"/Type3" not in content  # journals refuse such letters
        assert (b"/FontFile2" in content) != path.stem.endswith("-words")  # a cloud is shapes
        assert b"/CreationDate" not in content
    for path in folder.glob("*.svg"):
        ElementTree.parse(path)
        assert "<dc:date>" not in path.read_text()


def test_same_bytes_whenever_wherever_and_with_any_number_of_workers(
    of_one: Callable[[str], OfOne], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The other report was made by one worker, in the folder of all of this file."""
    before = {
        path.name: path.read_bytes() for path in (of_one("youtube").root / "report").iterdir()
    }
    shutil.copytree(of_one("youtube").root / "clean", tmp_path / "clean")
    monkeypatch.setenv("KB_NOW", "2027-12-31T23:59:59Z")
    monkeypatch.setenv("TZ", "Asia/Tokyo")
    time.tzset()
    report(a_run(tmp_path, workers=3), figures=True)
    after = {path.name: path.read_bytes() for path in (tmp_path / "report").iterdir()}
    assert after == before
    assert len(after) == 3 * 8 + 2  # three files a figure, the page and the manifest


def test_an_empty_root_gives_no_page_and_says_what_to_do(tmp_path: Path) -> None:
    with pytest.raises(FatalError, match="no tables in ") as caught:
        report(a_run(tmp_path))
    assert (caught.value.exit_code, "kb demo" in caught.value.hint) == (1, True)
    assert not list(tmp_path.iterdir())


def test_a_download_has_a_report_outside_of_it(
    tmp_path: Path, make_rows: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    download = tmp_path / "download"
    for name in ("pairs/pairs", "tasks/tasks"):
        source, _, short = name.partition("/")
        path = download / source / f"{short}-00000-of-00001.parquet"
        write_table(path, make_rows(name, 5, released=True), name, released=True)
    before = sorted(download.rglob("*"))
    page = Path(report(a_run(download))["page"])
    assert page.is_relative_to(tmp_path / "cache")
    assert "No data of Video-text pairs" not in page.read_text()
    report(a_run(download), tmp_path / "out")
    assert (tmp_path / "out" / "index.html").is_file()
    assert sorted(download.rglob("*")) == before


def test_a_demo_and_scores_of_the_tiny_model_are_marked(
    of_one: Callable[[str], OfOne], tmp_path: Path
) -> None:
    root, page, _, _ = of_one("wiki")  # the source with the fewest figures
    assert json.loads((root / "clean" / "wiki" / "summary.json").read_text()) == {
        "model": "toxic_original"
    }
    assert "tiny model" not in page
    assert "invented" not in page
    shutil.copytree(root / "clean", tmp_path / "clean")
    (tmp_path / "clean" / "wiki" / "summary.json").write_text('{"model": "lorecrawl_tiny"}')
    demo_mark.write_mark(tmp_path, finished=True)
    report(a_run(tmp_path))
    page = (tmp_path / "report" / "index.html").read_text()
    assert "tiny model" in page
    assert page.count(demo_mark.NOTE) == 1


def test_any_name_of_the_data_root(tmp_path: Path) -> None:
    odd = tmp_path / "a#b?c%41[d]*'e{f,g}"
    pages = []
    for place in (odd, tmp_path / "plain"):
        build(place, sources=("pairs",), export=False, n=10)
        frontier = Frontier(place / "state" / "wiki.sqlite")
        frontier.spend("wiki", 0, "parse", "2026-11-01")
        frontier.close()
        report(a_run(place))
        pages.append((place / "report" / "index.html").read_bytes())
    assert pages[0] == pages[1]
    assert {path.name for path in tmp_path.iterdir()} == {odd.name, "plain"}


def test_a_table_of_one_row_with_nothing_in_it(tmp_path: Path) -> None:
    """All that may be null is null, texts are empty, counts are 0."""

    def edit(name: str, made: list[dict[str, Any]]) -> None:
        del made[1:]
        for column in table(name).columns:
            if column.nullable:
                made[0][column.name] = None
            elif column.name.endswith(("_count", "_comments", "duration_s", "score")):
                made[0][column.name] = 0
            elif column.name == "title":
                made[0][column.name] = ""

    build(tmp_path, edit, export=False, n=1)
    for path in (tmp_path / "clean").glob("*/rejected/*"):
        path.unlink()
    summary = report(a_run(tmp_path))
    assert summary["without"] == "Services"
    made = {path.stem for path in (tmp_path / "report").glob("*.svg")}
    assert {"youtube-durations", "wiki-elements", "reddit-types", "pairs-lengths"} <= made
    # An element without a box, as what is folded has none, is on no picture of its page.
    without = {"wiki-page", "youtube-dates", "youtube-channels", "youtube-videos-toxicity"}
    assert not without & made


@pytest.mark.parametrize("source", BY_DEFAULT)
def test_a_root_of_one_source(of_one: Callable[[str], OfOne], source: str) -> None:
    page = of_one(source).page
    assert page.count("No data of") == len(BY_DEFAULT) - 1
    assert "may not be passed on" in page


def test_missing_sources_are_said_in_a_line(of_one: Callable[[str], OfOne]) -> None:
    _, page, summary, _ = of_one("youtube")
    assert summary["without"] == "Wiki, Reddit, Video-text pairs, Tasks, Entities, Services"
    assert (
        "No data of Reddit yet: run `kb reddit crawl` or `kb reddit import FILE`,"
        " then `kb reddit filter`."
    ) in page
    assert "No data of YouTube" not in page


def test_what_the_profile_leaves_out_has_no_section(
    of_one: Callable[[str], OfOne], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The wiki alone: neither videos and their pairs nor an empty figure of Reddit."""
    root = of_one("wiki").root  # the source with the fewest figures
    monkeypatch.delitem(charts.FORMATS, "pdf")
    run = a_run(root)
    only = run.profile.model_copy(update={"youtube": None, "reddit": None, "pairs": None})
    report(dataclasses.replace(run, profile=only), tmp_path / "out")
    page = (tmp_path / "out" / "index.html").read_text()
    sections = re.findall(r'<section id="([a-z]+)"', page)
    assert sections == ["wiki", "links", "services"]
    assert "run `kb links`" in page


def test_totals_count_what_there_is(root: Path) -> None:
    page = (root / "report" / "index.html").read_text()
    totals = {what: n for n, what in re.findall(r"<div><b>([^<]+)</b>([^<]+)</div>", page)}
    with duckdb.connect() as con:
        ((videos, hours),) = con.execute(
            "SELECT count(*), sum(duration_s) / 3600 FROM read_parquet(?)",
            [str(root / "clean" / "youtube" / "videos" / "*.parquet")],
        ).fetchall()
    assert totals["videos"] == str(videos)
    shown = {noun: n for n, noun in overview.read(CurrentTables(root), {})["totals"]}
    assert shown.keys() == totals.keys()  # the overview of kb explore
    for noun, text in totals.items():
        if text.replace(",", "").isdigit():  # the report shortens from 10,000 on
            assert text == shown[noun]
    about = facts(a_run(root))  # kb status
    rows = {noun: n for source in about["sources"].values() for noun, n in source["rows"].items()}
    rows |= {"video-text pairs": about["pairs"]["clean"], "tasks": about["tasks"], **about["links"]}
    same = {noun for noun in rows.keys() & totals.keys() if noun != "links"}
    assert same >= {"videos", "pages", "posts", "comments", "video-text pairs", "tasks", "entities"}
    assert {noun: f"{rows[noun]:,}" for noun in same} == {noun: totals[noun] for noun in same}
    assert float(totals["hours of video"]) == pytest.approx(hours, rel=0.06)
    assert {"years of video", "words spoken", "pages", "boxes", "posts", "comments", "tasks"} <= {
        *totals
    }
    assert "titles" not in totals  # those that gave no task


def test_samples_read_well(root: Path) -> None:
    """Titles lead to their items, numbers stand under their headings, values have words."""
    page = (root / "report" / "index.html").read_text()
    videos = page[page.index("Some videos") :].partition("</table>")[0]
    assert '<th scope="col" class="n">Views</th>' in videos
    assert re.search(r'<td[^>]*><a href="https://www\.youtube\.com/watch\?v=[^"]+" rel=', videos)
    assert not re.search(r">(asr|manual|no_verb|not_a_task|view_count)<", page)


def test_what_people_wrote_is_text_and_never_markup(of_one: Callable[[str], OfOne]) -> None:
    page = of_one("reddit").page
    assert "<script" not in page
    assert "&lt;script&gt;" in page


def test_page_needs_nothing_outside_itself(root: Path) -> None:
    page = (root / "report" / "index.html").read_text()
    assert re.findall(r"<(?:script|link|iframe|object)", page) == []
    assert all(source.startswith("data:") for source in re.findall(r'src="([^"]*)"', page))
    links = re.findall(r'(?<=<)(\w+)[^>]*? (?:xlink:)?href="([^"]*)"([^>]*)>', page)
    assert all(
        to.startswith(("#", "data:image/")) or (tag == "a" and "noreferrer" in rest)
        for tag, to, rest in links
    )
    assert all(text.strip() for text in re.findall(r'(?:alt|aria-label)="([^"]*)"', page))
    assert len(re.findall(r"<figure ", page)) == len(FIGURES)


def test_the_page_says_that_its_texts_may_not_be_passed_on(root: Path) -> None:
    page = (root / "report" / "index.html").read_text()
    assert page.index("may not be passed on") < page.index("<figure ")
