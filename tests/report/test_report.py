"""`kb report` over made data: the figures' numbers, the same bytes twice,
and what is missing is said.
"""

from __future__ import annotations

import functools
import json
import re
import shutil
import time
import warnings
import zlib
from collections.abc import Callable
from datetime import timedelta
from io import BytesIO
from pathlib import Path
from typing import Any, NamedTuple
from xml.etree import ElementTree

import duckdb
import pytest

from kb.core.context import Run
from kb.core.errors import DamagedData, FatalError
from kb.core.profile import load_profile
from kb.core.settings import load_settings
from kb.core.sources import PUBLISHED
from kb.core.verdict import Summary
from kb.report import links, pairs, services, style, wikipage, youtube
from kb.report.build import report
from kb.report.data import ReportData
from kb.report.funnel import funnel
from kb.report.style import readable
from kb.report.toxicity import toxicity
from kb.schema import table
from kb.store.frontier import Frontier
from kb.store.shards import write_table
from tests.release.made import START, build, rows

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
    "pairs-keywords",
    "pairs-lengths",
    "links-most",
    "links-least",
    "links-known",
    "quota",
}


def a_run(root: Path, workers: int = 1) -> Run:
    return Run(load_settings(dotenv=False), load_profile("minecraft"), root, workers=workers)


class OfOne(NamedTuple):
    """The report of a root that has one source alone."""

    root: Path
    page: str
    summary: Summary
    warned: list[str]


@pytest.fixture
def no_pdf(monkeypatch: pytest.MonkeyPatch) -> None:
    """For a question about the page, which shows the others: half of a report is its PDF."""
    monkeypatch.delitem(style.FORMATS, "pdf")


MODEL = {"model": "toxic_original"}


def _odd(name: str, made: list[dict[str, Any]]) -> None:
    """Markup in a title, labels of any script and sign."""
    for index, row in enumerate(made):
        if name == "reddit/posts":
            row["title"] = (
                '<script>alert("x")</script><img src=http://evil.example/x.png onerror=alert(1)>'
            )
        if "keyword" in row:
            row["keyword"] = ("$x_{", "採掘\n🧱", "a" * 80)[index % 3]
        if "channel_title" in row or name == "youtube/videos":
            row["channel_title"] = "$^$ 採掘"


@pytest.fixture(scope="module")
def of_one(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], OfOne]:
    """of_one(source): made once; the root is read only."""

    @functools.cache
    def make(source: str) -> OfOne:
        root = tmp_path_factory.mktemp(source)
        (root / "state").mkdir()
        build(root, _odd, sources=(source,), export=False, n=20)
        if source == "wiki":
            (root / "clean" / "wiki" / "summary.json").write_text(json.dumps(MODEL))
        with warnings.catch_warnings(record=True) as warned:
            warnings.simplefilter("always")
            summary = report(a_run(root))
        page = (root / "report" / "index.html").read_text()
        return OfOne(root, page, summary, [str(one.message) for one in warned])

    return make


def embedded(pdf: bytes) -> list[set[str]]:
    """The tables of each TrueType font in a PDF."""
    from fontTools.ttLib import TTFont

    fonts = []
    for number in re.findall(rb"/FontFile2 (\d+) 0 R", pdf):
        stream = re.search(rb"(?s)\n%s 0 obj\n.*?\nstream\n(.*?)\nendstream" % number, pdf)
        assert stream
        fonts.append(set(TTFont(BytesIO(zlib.decompress(stream[1]))).keys()) - {"GlyphOrder"})
    return fonts


def test_every_figure_is_there_as_svg_png_and_pdf(root: Path) -> None:
    folder = root / "report"
    for suffix in ("svg", "png", "pdf"):
        assert {path.stem for path in folder.glob(f"*.{suffix}")} == FIGURES
    for path in folder.glob("*.pdf"):
        content = path.read_bytes()
        assert content.startswith(b"%PDF-")
        assert b"/Type3" not in content  # journals refuse such letters
        fonts = embedded(content)
        assert bool(fonts) != path.stem.endswith("-words")  # a cloud is shapes
        for tables in fonts:
            assert tables == {
                "glyf",
                "head",
                "hhea",
                "hmtx",
                "loca",
                "maxp",
                "cvt ",
                "fpgm",
                "prep",
            }
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
    report(a_run(tmp_path, workers=3))
    after = {path.name: path.read_bytes() for path in (tmp_path / "report").iterdir()}
    assert after == before
    assert len(after) == 3 * 8 + 1


def test_durations_end_at_the_percentile_of_the_profile(root: Path) -> None:
    data, profile = ReportData(a_run(root)), load_profile("minecraft")
    figure = youtube.durations(data, profile)
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
    figure = funnel(ReportData(a_run(root)), load_profile("minecraft"), "youtube/videos")
    assert figure is not None
    assert figure.rows[0] == ("crawled", 222, 0)
    assert ("views", 157, 31) in [tuple(row) for row in figure.rows]
    assert figure.rows[-1] == ("kept", 120, 0)
    gone = [row[2] for row in figure.rows]
    left = [row[1] for row in figure.rows]
    assert all(a - g == b for a, b, g in zip(left, left[1:], gone[1:], strict=False))


def test_posts_and_comments_share_a_rejected_table_but_no_funnel(root: Path) -> None:
    data = ReportData(a_run(root))
    posts, comments = data.funnel("reddit/posts"), data.funnel("reddit/comments")
    assert posts is not None
    assert comments is not None
    assert (posts.kept, posts.crawled) == (120, 182)
    assert (comments.kept, comments.crawled) == (360, 360)


def test_quota_adds_up_by_day(root: Path) -> None:
    figure = services.quota(ReportData(a_run(root)), load_profile("minecraft"))
    assert figure is not None
    assert sorted(tuple(row) for row in figure.rows) == sorted(
        [
            (f"2026-11-0{day}", f"youtube {bucket}", day * units)
            for day in (1, 2, 3)
            for bucket, units in (("general", 5), ("search", 1))
        ]
    )


def test_pair_lengths_count_every_pair(root: Path) -> None:
    figure = pairs.lengths(ReportData(a_run(root)), load_profile("minecraft"))
    assert figure is not None
    assert sum(n for _, n in figure.rows) == 240


def test_word_cloud_counts_rows_not_mentions(root: Path) -> None:
    data = ReportData(a_run(root))
    found = dict(data.words("reddit/posts", ("title", "body"), set(), 200))
    texts = [
        set(re.findall(r"[a-z]+", f"{row['title']} {row['body']}"))
        for row in rows(120)["reddit/posts"]
    ]
    assert found["honey"] == sum("honey" in words for words in texts)


def test_an_empty_root_gives_no_page_and_says_what_to_do(tmp_path: Path) -> None:
    with pytest.raises(FatalError, match="no tables in ") as caught:
        report(a_run(tmp_path))
    assert (caught.value.exit_code, "kb demo" in caught.value.hint) == (1, True)
    assert not list(tmp_path.iterdir())


@pytest.mark.usefixtures("no_pdf")
def test_a_download_has_a_report_outside_of_it(
    tmp_path: Path, make_rows: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    download = tmp_path / "download"
    for name in ("youtube/videos", "reddit/posts", "pairs/pairs"):
        source, _, short = name.partition("/")
        path = download / source / f"{short}-00000-of-00001.parquet"
        write_table(path, make_rows(name, 5, released=True), name, released=True)
    before = sorted(download.rglob("*"))
    page = Path(report(a_run(download))["page"])
    assert page.is_relative_to(tmp_path / "cache")
    assert "No data of YouTube" not in page.read_text()
    report(a_run(download), tmp_path / "out")
    assert (tmp_path / "out" / "index.html").is_file()
    assert sorted(download.rglob("*")) == before


def test_what_people_wrote_is_text_and_never_markup(of_one: Callable[[str], OfOne]) -> None:
    page = of_one("reddit").page
    assert "<script" not in page
    assert "&lt;script&gt;" in page


def test_page_needs_nothing_outside_itself(root: Path) -> None:
    page = (root / "report" / "index.html").read_text()
    assert re.findall(r"<(?:script|link|iframe|object)", page) == []
    assert all(source.startswith("data:") for source in re.findall(r'src="([^"]*)"', page))
    assert all(target.startswith("#") for target in re.findall(r'href="([^"]*)"', page))
    assert all(text.strip() for text in re.findall(r'alt="([^"]*)"', page))
    assert len(re.findall(r"<figure ", page)) == len(FIGURES)


@pytest.mark.usefixtures("no_pdf")
def test_scores_of_the_tiny_model_are_marked(
    of_one: Callable[[str], OfOne], tmp_path: Path
) -> None:
    root, page, _, _ = of_one("wiki")  # the source with the fewest figures
    assert json.loads((root / "clean" / "wiki" / "summary.json").read_text()) == MODEL
    assert "tiny model" not in page
    shutil.copytree(root / "clean", tmp_path / "clean")
    (tmp_path / "clean" / "wiki" / "summary.json").write_text('{"model": "lorecrawl_tiny"}')
    report(a_run(tmp_path))
    assert "tiny model" in (tmp_path / "report" / "index.html").read_text()


@pytest.mark.usefixtures("no_pdf")
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


@pytest.mark.usefixtures("no_pdf")
def test_a_damaged_picture_is_named(tmp_path: Path) -> None:
    from PIL import Image

    build(tmp_path, sources=("wiki",), export=False, n=10)
    with ReportData(a_run(tmp_path)) as data:
        shots = [
            tmp_path / row[0] for row in data.rows("wiki/pages", "SELECT screenshot_path FROM {t}")
        ]
    for shot in shots:
        shot.parent.mkdir(parents=True, exist_ok=True)
        Image.effect_noise((1280, 900), 64).save(shot)
        cut(shot)
    with pytest.raises(DamagedData, match=r"the screenshot .* can't be read") as caught:
        report(a_run(tmp_path))
    assert "restore it from a copy, or remove it" in caught.value.hint
    assert not (tmp_path / "report").exists()


@pytest.mark.usefixtures("no_pdf")
def test_a_damaged_file_is_named(tmp_path: Path) -> None:
    build(tmp_path, sources=("pairs",), export=False, n=10)
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


@pytest.mark.usefixtures("no_pdf")
def test_command_prints_its_page(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    from kb.cli import main

    (tmp_path / "state").mkdir()
    build(tmp_path, sources=("pairs",), export=False, n=10)
    with pytest.raises(SystemExit) as left:
        main(["report", "--data", str(tmp_path), "--json", "--quiet"])
    assert not left.value.code
    summary = json.loads(capsys.readouterr().out.splitlines()[-1])
    assert summary["figures"] == 2
    assert Path(summary["page"]).is_file()


def test_each_service_has_a_scale_of_its_own(root: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Thirty units beside six: each panel is as high as its own largest day."""
    sheets: list[Any] = []
    monkeypatch.setattr(services, "saved", lambda sheet: sheets.append(sheet) or {})
    services.quota(ReportData(a_run(root)), load_profile("minecraft"))
    tops = [panel.get_ylim()[1] for panel in sheets[0].axes]
    assert [panel.get_title(loc="left") for panel in sheets[0].axes] == [
        "YouTube: general",
        "YouTube: search",
    ]
    assert [panel.get_ylabel() for panel in sheets[0].axes] == ["units", "units"]
    assert tops == pytest.approx([15 * 1.08, 3 * 1.08])


def test_boxes_cover_nothing_of_the_page_and_a_pixel_is_a_pixel(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from PIL import Image

    for other in style.FORMATS.keys() - {"png"}:
        monkeypatch.delitem(style.FORMATS, other)

    build(tmp_path, sources=("wiki",), export=False, n=10)
    for page in range(1, 4):
        path = tmp_path / "raw" / "wiki" / "pages" / f"{page}.png"
        path.parent.mkdir(parents=True, exist_ok=True)
        Image.effect_noise((1280, 900), 64).convert("RGB").save(path, compress_level=1)
    data = ReportData(a_run(tmp_path))
    _, detail = wikipage.page(data, load_profile("minecraft"))
    width, height, left, top = map(int, re.findall(r"\d+", detail.caption)[:4])
    shown = Image.open(BytesIO(detail.files["png"])).convert("RGB")
    assert shown.width == 2 * width
    shown = shown.crop((0, shown.height - 2 * height, 2 * width, shown.height))
    url = detail.caption.rpartition("_")[2]
    page = Image.open(tmp_path / "raw" / "wiki" / "pages" / f"{int(url) + 1}.png")
    boxes = data.rows(
        "wiki/elements",
        "SELECT x, y, width, height FROM {t} WHERE page_id = 1 AND lines IS NULL UNION ALL"
        " SELECT l.x, l.y, l.width, l.height FROM"
        " (SELECT unnest(lines) AS l FROM {t} WHERE page_id = 1)",
    )
    inside = [
        (x - left, y - top, x - left + w, y - top + h)
        for x, y, w, h in boxes
        if x >= left and y >= top and x + w <= left + width and y + h <= top + height
    ]
    assert len(inside) >= 4
    part = page.crop((left, top, left + width, top + height)).resize(
        (2 * width, 2 * height), Image.Resampling.NEAREST
    )
    for box in inside:
        place = tuple(round(2 * edge) for edge in box)
        assert shown.crop(place).tobytes() == part.crop(place).tobytes()


@pytest.mark.usefixtures("no_pdf")
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
    assert {"youtube-durations", "wiki-page", "reddit-types", "pairs-lengths"} <= made
    assert not {"youtube-dates", "youtube-channels", "youtube-videos-toxicity"} & made


def test_what_is_spoken_of_and_who_knows_it(tmp_path: Path) -> None:
    def edit(name: str, made: list[dict[str, Any]]) -> None:
        if name == "links/entities":
            made.append({**made[0], "entity": "never named", "wiki_page_id": None})
        if name == "links/links":
            for row in made:
                row["count"] = 2

    build(tmp_path, edit, sources=("links",), export=False, n=12)
    profile = load_profile("minecraft")
    with ReportData(a_run(tmp_path)) as data:
        most, least, known = (
            make(data, profile) for make in (links.most, links.least, links.known)
        )
    assert most is not None
    assert least is not None
    assert known is not None
    assert most.head == ("entity", "youtube", "wiki", "reddit", "mentions")
    assert most.rows == [
        ("oak log", 24, 24, 24, 72),
        ("diamond", 12, 12, 12, 36),
        ("iron pickaxe", 8, 8, 8, 24),
        ("wolf", 6, 6, 6, 18),
        ("wheat", 4, 0, 0, 4),
    ]
    assert least.rows == [*most.rows][::-1]
    assert least.caption.startswith("Named nowhere: 1 entities;")
    assert known.rows == [
        ("only videos", 1, "wheat"),
        ("only the wiki", 0, ""),
        ("only threads", 0, ""),
        ("two of the three", 0, ""),
        ("all three", 4, "oak log, diamond, iron pickaxe, wolf"),
    ]
    assert known.caption.endswith("one source alone names 1, none 1.")


@pytest.mark.parametrize("source", PUBLISHED)
def test_a_root_of_one_source(of_one: Callable[[str], OfOne], source: str) -> None:
    page = of_one(source).page
    assert page.count("No data of") == len(PUBLISHED) - 1
    assert "may not be passed on" in page


def test_missing_sources_are_said_in_a_line(of_one: Callable[[str], OfOne]) -> None:
    _, page, summary, _ = of_one("youtube")
    assert summary["without"] == "Wiki, Reddit, Video-text pairs, Entities, Services"
    assert (
        "No data of Reddit yet: run `kb reddit crawl` or `kb reddit import FILE`,"
        " then `kb reddit filter`."
    ) in page
    assert "No data of YouTube" not in page


def test_the_page_says_that_its_texts_may_not_be_passed_on(root: Path) -> None:
    page = (root / "report" / "index.html").read_text()
    assert page.index("may not be passed on") < page.index("<figure ")


def test_dates_are_counted_by_a_step_that_gives_few_bars(tmp_path: Path) -> None:
    def edit(name: str, made: list[dict[str, Any]]) -> None:
        for index, row in enumerate(made if name == "youtube/videos" else []):
            row["published_at"] = START + timedelta(days=index // 2) if index else None
        for index, row in enumerate(made if name == "reddit/posts" else []):
            row["created_utc"] = START.replace(year=2006 + index)

    build(tmp_path, edit, sources=("youtube", "reddit"), export=False, n=20)
    data = ReportData(a_run(tmp_path))
    step, days = data.timeline("youtube/videos", "published_at") or ("", [])
    assert (step, days[0], days[1]) == ("day", ("2026-11-01", 1), ("2026-11-02", 2))
    step, years = data.timeline("reddit/posts", "created_utc") or ("", [])
    assert (step, len(years), sum(n for _, n in years)) == ("year", 20, 20)


def test_scores_of_kept_and_dropped_rows_meet_at_the_threshold(tmp_path: Path) -> None:
    def edit(name: str, made: list[dict[str, Any]]) -> None:
        for row in made if name == "youtube/videos" else []:
            row["toxicity_title"], row["toxicity_description"] = 0.01, 0.42

    build(tmp_path, edit, sources=("youtube",), export=False, n=20)
    figure = toxicity(
        ReportData(a_run(tmp_path)),
        load_profile("minecraft"),
        "youtube/videos",
        ("toxicity_title", "toxicity_description"),
    )
    assert figure is not None
    assert [row for row in figure.rows if row[1] or row[2]] == [
        ("0.40 to 0.45", 20, 0),
        ("0.90 to 0.95", 0, 4),
    ]
    assert "dropped above 0.5" in figure.caption


def test_share_of_the_channels(root: Path) -> None:
    share = ReportData(a_run(root)).channels(3)
    assert share is not None
    assert (share.videos, share.channels, share.half, len(share.largest)) == (120, 7, 4, 3)


def test_labels_of_any_script_and_sign(of_one: Callable[[str], OfOne]) -> None:
    """A dollar is no formula, and what the font can't draw is a question mark, not a warning."""
    warned = [*of_one("youtube").warned, *of_one("pairs").warned]
    assert not [text for text in warned if "missing from font" in text]
    assert readable("採掘\n🧱 ok") == "?? ? ok"
    assert len(readable("a" * 80)) == 26
