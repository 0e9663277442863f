"""A report of all figures, for whoever only reads it."""

from __future__ import annotations

from pathlib import Path

import pytest

from kb.core.context import Run
from kb.core.profile import load_profile
from kb.core.settings import load_settings
from kb.report.build import report
from kb.store.frontier import Frontier
from tests.once import once
from tests.release.made import build


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
    report(Run(load_settings(dotenv=False), load_profile("minecraft"), root, workers=1))
