"""`kb report` over made data: the figures' numbers, the same bytes twice, and what is missing is said."""

from __future__ import annotations

import json
import re
from pathlib import Path
from xml.etree import ElementTree

import duckdb
import pytest

from kb.core.context import Run
from kb.core.errors import DamagedData
from kb.core.profile import load_profile
from kb.core.settings import load_settings
from kb.report import figures
from kb.report.build import report
from kb.report.data import Data
from kb.store.frontier import Frontier
from tests.release.made import build, rows

FIGURES = {
    "youtube-videos-funnel",
    "youtube-durations",
    "youtube-views",
    "youtube-words",
    "wiki-page",
    "wiki-pages-funnel",
    "wiki-elements",
    "reddit-posts-funnel",
    "reddit-types",
    "reddit-scores",
    "reddit-comments-funnel",
    "reddit-words",
    "pairs-keywords",
    "pairs-lengths",
    "quota",
}


def a_run(root: Path, workers: int = 1) -> Run:
    return Run(load_settings(dotenv=False), load_profile("minecraft"), root, workers=workers)


@pytest.fixture(scope="module")
def root(tmp_path_factory: pytest.TempPathFactory) -> Path:
    from PIL import Image, ImageDraw

    root = build(tmp_path_factory.mktemp("data"), export=False, n=120)
    for page in range(1, 13):
        picture = Image.new("RGB", (1280, 900), "white")
        ImageDraw.Draw(picture).text((40, 40), f"page {page}", fill="black")
        path = root / "raw" / "wiki" / "pages" / f"{page}.png"
        path.parent.mkdir(parents=True, exist_ok=True)
        picture.save(path)
    frontier = Frontier(root / "state" / "youtube.sqlite")
    for day in (1, 2, 3):
        for _ in range(day):
            frontier.spend("search", 1, "search.list", f"2026-11-0{day}")
            frontier.spend("general", 5, "videos.list", f"2026-11-0{day}")
    frontier.close()
    report(a_run(root))
    return root


def test_every_figure_is_there_as_svg_and_png(root: Path) -> None:
    folder = root / "report"
    assert {path.stem for path in folder.glob("*.svg")} == FIGURES
    assert {path.stem for path in folder.glob("*.png")} == FIGURES
    for path in folder.glob("*.svg"):
        ElementTree.parse(path)
        assert "<dc:date>" not in path.read_text()


def test_same_bytes_whenever_and_with_any_number_of_workers(tmp_path: Path) -> None:
    build(tmp_path, sources=("youtube",), export=False, n=40)
    contents = []
    for workers in (1, 3):
        report(a_run(tmp_path, workers=workers))
        contents.append({path.name: path.read_bytes() for path in (tmp_path / "report").iterdir()})
    assert contents[0] == contents[1]
    assert len(contents[0]) == 2 * 4 + 1


def test_durations_end_at_the_percentile_of_the_profile(root: Path) -> None:
    data, profile = Data(a_run(root)), load_profile("minecraft")
    figure = figures.durations(data, profile)
    files = [str(path) for path in (root / "clean" / "youtube" / "videos").glob("*.parquet")]
    limit = (
        duckdb.connect()
        .execute("SELECT quantile_disc(duration_s, 0.85) FROM read_parquet(?)", [files])
        .fetchone()[0]
    )
    shown = (
        duckdb.connect()
        .execute("SELECT count(*) FROM read_parquet(?) WHERE duration_s <= ?", [files, limit])
        .fetchone()[0]
    )
    assert figure is not None
    assert sum(n for _, n in figure.rows) == shown
    assert 0.84 <= shown / 120 <= 0.87
    assert f"{limit / 60:.1f} minutes" in figure.caption


def test_funnel_loses_exactly_what_the_stages_dropped(root: Path) -> None:
    figure = figures.funnel(Data(a_run(root)), "youtube/videos")
    assert figure is not None
    assert figure.rows[0] == ("crawled", 222, 0)
    assert ("views", 157, 31) in [tuple(row) for row in figure.rows]
    assert figure.rows[-1] == ("kept", 120, 0)
    gone = [row[2] for row in figure.rows]
    left = [row[1] for row in figure.rows]
    assert all(a - g == b for a, b, g in zip(left, left[1:], gone[1:], strict=False))


def test_posts_and_comments_share_a_rejected_table_but_no_funnel(root: Path) -> None:
    data = Data(a_run(root))
    posts, comments = data.funnel("reddit/posts"), data.funnel("reddit/comments")
    assert posts is not None
    assert comments is not None
    assert (posts.kept, posts.crawled) == (120, 182)
    assert (comments.kept, comments.crawled) == (360, 360)


def test_quota_adds_up_by_day(root: Path) -> None:
    figure = figures.quota(Data(a_run(root)), load_profile("minecraft"))
    assert figure is not None
    assert sorted(tuple(row) for row in figure.rows) == sorted(
        [
            (f"2026-11-0{day}", f"youtube {bucket}", day * units)
            for day in (1, 2, 3)
            for bucket, units in (("general", 5), ("search", 1))
        ]
    )


def test_pair_lengths_count_every_pair(root: Path) -> None:
    figure = figures.lengths(Data(a_run(root)), load_profile("minecraft"))
    assert figure is not None
    assert sum(n for _, n in figure.rows) == 240


def test_word_cloud_counts_rows_not_mentions(root: Path) -> None:
    data = Data(a_run(root))
    found = dict(data.words("reddit/posts", ("title", "body"), set(), 200))
    texts = [
        set(re.findall(r"[a-z]+", f"{row['title']} {row['body']}"))
        for row in rows(120)["reddit/posts"]
    ]
    assert found["honey"] == sum("honey" in words for words in texts)


def test_missing_sources_are_said_in_a_line(tmp_path: Path) -> None:
    build(tmp_path, sources=("youtube",), export=False, n=30)
    summary = report(a_run(tmp_path))
    page = (tmp_path / "report" / "index.html").read_text()
    assert summary["without"] == "Wiki, Reddit, Video-text pairs, Services"
    assert (
        "No data of Reddit yet: run `kb reddit crawl` or `kb reddit import`, then `kb reddit filter`."
        in page
    )
    assert "No data of YouTube" not in page


def test_an_empty_root_gives_a_page_that_says_so(tmp_path: Path) -> None:
    report(a_run(tmp_path))
    assert "No data yet." in (tmp_path / "report" / "index.html").read_text()


def test_what_people_wrote_is_text_and_never_markup(tmp_path: Path) -> None:
    def edit(name: str, made: list[dict]) -> None:  # type: ignore[type-arg]
        for row in made:
            if name == "reddit/posts":
                row["title"] = (
                    '<script>alert("x")</script><img src=http://evil.example/x.png onerror=alert(1)>'
                )

    build(tmp_path, edit, sources=("reddit",), export=False, n=10)
    report(a_run(tmp_path))
    page = (tmp_path / "report" / "index.html").read_text()
    assert "<script" not in page
    assert "&lt;script&gt;" in page


def test_page_needs_nothing_outside_itself(root: Path) -> None:
    page = (root / "report" / "index.html").read_text()
    assert re.findall(r"<(?:script|link|iframe|object)", page) == []
    assert all(source.startswith("data:") for source in re.findall(r'src="([^"]*)"', page))
    assert all(target.startswith("#") for target in re.findall(r'href="([^"]*)"', page))
    assert all(text.strip() for text in re.findall(r'alt="([^"]*)"', page))
    assert len(re.findall(r"<figure ", page)) == len(FIGURES)


def test_scores_of_the_tiny_model_are_marked(tmp_path: Path) -> None:
    build(tmp_path, sources=("youtube",), export=False, n=10)
    summary = tmp_path / "clean" / "youtube" / "summary.json"
    summary.write_text('{"model": "toxic_original"}')
    report(a_run(tmp_path))
    assert "tiny model" not in (tmp_path / "report" / "index.html").read_text()
    summary.write_text('{"model": "lorebase_tiny"}')
    report(a_run(tmp_path))
    assert "tiny model" in (tmp_path / "report" / "index.html").read_text()


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


def cut(path: Path) -> str:
    path.write_bytes(path.read_bytes()[:100])
    return path.name


def test_a_damaged_file_is_named(tmp_path: Path) -> None:
    from PIL import Image

    build(tmp_path, sources=("wiki", "pairs"), export=False, n=10)
    with Data(a_run(tmp_path)) as data:
        shots = [
            tmp_path / row[0] for row in data.rows("wiki/pages", "SELECT screenshot_path FROM {t}")
        ]
    for shot in shots:
        shot.parent.mkdir(parents=True, exist_ok=True)
        Image.effect_noise((1280, 900), 64).save(shot)
        cut(shot)
    with pytest.raises(DamagedData, match=r"the screenshot .* can't be read") as caught:
        report(a_run(tmp_path))
    assert "put it back from a copy, or remove it" in caught.value.hint
    for shot in shots:
        shot.unlink()
    path = tmp_path / "state" / "reddit.sqlite"
    path.parent.mkdir(exist_ok=True)
    path.write_text("garbage")
    with pytest.raises(DamagedData, match=r"reddit\.sqlite can't be read"):
        report(a_run(tmp_path))
    path.unlink()
    name = cut(next((tmp_path / "pairs").glob("*.parquet")))
    with pytest.raises(DamagedData, match=f"pairs/{name} can't be read") as caught:
        report(a_run(tmp_path))
    assert caught.value.hint == "run `kb pairs --again`"
    assert not (tmp_path / "report").exists()


def test_command_prints_its_page(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    from kb.cli.app import main

    build(tmp_path, sources=("pairs",), export=False, n=10)
    with pytest.raises(SystemExit) as left:
        main(["report", "--data", str(tmp_path), "--json", "--quiet"])
    assert not left.value.code
    summary = json.loads(capsys.readouterr().out.splitlines()[-1])
    assert summary["figures"] == 2
    assert Path(summary["page"]).is_file()
