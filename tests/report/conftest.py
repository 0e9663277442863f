"""A report of all figures, for whoever only reads it."""

import functools
import json
import warnings
from collections.abc import Callable
from pathlib import Path

import pytest

from kb.store.state.frontier import Frontier
from tests.once import once
from tests.recipes import report
from tests.release.made import build
from tests.report.made import OfOne, a_run, odd


@pytest.fixture(scope="session")
def root(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The data root that it was made of; its report is in report/."""
    return once(tmp_path_factory, "reported", _make)


def _make(root: Path) -> None:
    from PIL import Image, ImageDraw

    build(root, export=False, n=120)
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
    report(a_run(root), figures=True)


@pytest.fixture(scope="session")
def of_one(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], OfOne]:
    """of_one(source): made once; the root is read only. Only the videos' has PDFs and a cloud."""

    @functools.cache
    def make(source: str) -> OfOne:
        root = tmp_path_factory.mktemp(source)
        (root / "state").mkdir()
        build(root, odd, sources=(source,), export=False, n=20)
        if source == "wiki":
            (root / "clean" / "wiki" / "summary.json").write_text(
                json.dumps({"model": "toxic_original"})
            )
        with warnings.catch_warnings(record=True) as warned:
            warnings.simplefilter("always")
            summary = report(a_run(root), figures=source == "youtube")
        page = (root / "report" / "index.html").read_text()
        return OfOne(root, page, summary, [str(one.message) for one in warned])

    return make
