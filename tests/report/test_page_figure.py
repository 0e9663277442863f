"""A page with the boxes of its elements."""

import re
from io import BytesIO
from pathlib import Path

import pytest

from kb.core.config.profile import load_profile
from kb.core.errors import DamagedData
from kb.look import charts
from kb.report.data import ReportData
from kb.wiki.report import pages
from tests.recipes import report
from tests.release.made import build
from tests.report.made import a_run


def cut(path: Path) -> str:
    path.write_bytes(path.read_bytes()[:100])
    return path.name


def test_boxes_cover_nothing_of_the_page_and_a_pixel_is_a_pixel(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from PIL import Image

    for other in charts.FORMATS.keys() - {"png"}:
        monkeypatch.delitem(charts.FORMATS, other)

    build(tmp_path, sources=("wiki",), export=False, n=10)
    for page in range(1, 4):
        path = tmp_path / "raw" / "wiki" / "pages" / f"{page}.png"
        path.parent.mkdir(parents=True, exist_ok=True)
        Image.effect_noise((1280, 900), 64).convert("RGB").save(path, compress_level=1)
    data = ReportData(a_run(tmp_path))
    _, detail, *_ = pages(data, load_profile("minecraft"))
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
    with pytest.raises(DamagedData, match=r"\.png can't be read") as caught:
        report(a_run(tmp_path))
    assert "restore it from a copy, or remove it" in caught.value.hint
    assert not (tmp_path / "report").exists()
