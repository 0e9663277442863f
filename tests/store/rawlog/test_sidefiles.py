"""Tests of `kb.store.rawlog.sidefiles`."""

import hashlib
from pathlib import Path

import pytest

from kb.core.errors import DamagedData
from kb.store.damage import forget_damage, note_damage
from kb.store.rawlog import sidefiles


def test_a_changed_image_is_damaged_by_its_name(tmp_path: Path) -> None:
    image = tmp_path / f"{hashlib.sha256(b'pixels').hexdigest()}.png"
    sidefiles.write_named(image, b"pixels")
    assert sidefiles.is_intact(image)
    image.write_bytes(b"pixelS")
    assert not sidefiles.is_intact(image)
    sidefiles.quarantine_file(image)
    assert not image.exists()
    assert sidefiles.quarantine_path(image).read_bytes() == b"pixelS"


def test_a_captured_page_is_compared_with_its_checksums(tmp_path: Path) -> None:
    page = tmp_path / "page.html"
    page.write_text("a page")
    sidefiles.write_sums(tmp_path)
    assert sidefiles.is_intact(page)
    page.write_text("b page")
    assert not sidefiles.is_intact(page)


def test_suspects_are_listed_until_they_are_intact_or_forgotten(tmp_path: Path) -> None:
    image = tmp_path / "raw/wiki/images" / f"{hashlib.sha256(b'pixels').hexdigest()}.png"
    image.parent.mkdir(parents=True)
    (tmp_path / "state").mkdir()
    note_damage(tmp_path, [image])
    assert sidefiles.suspects(tmp_path) == [str(image.relative_to(tmp_path))]
    sidefiles.write_named(image, b"pixels")
    assert sidefiles.suspects(tmp_path) == []
    image.unlink()
    forget_damage(tmp_path, image.parent)
    assert sidefiles.suspects(tmp_path) == []


@pytest.mark.parametrize("path", ["raw/wiki/../youtube/a", "/etc/passwd", "state/wiki.sqlite"])
def test_a_path_outside_the_captures_is_refused(tmp_path: Path, path: str) -> None:
    with pytest.raises(DamagedData):
        sidefiles.captured_path(tmp_path, path)
    inside = sidefiles.captured_path(tmp_path, "raw/wiki/pages/1/2/page.html")
    assert inside == tmp_path / "raw/wiki/pages/1/2/page.html"
