"""Links to folders are walked through; those that lead back or nowhere are named."""

from pathlib import Path

import pytest

from kb.core.errors import DamagedData
from kb.store.walk import files_below, walk


@pytest.fixture
def root(tmp_path: Path) -> Path:
    """A data root with pages on another disk, of which one is on a third."""
    root, pages, page = tmp_path / "data", tmp_path / "disk/pages", tmp_path / "third/7"
    for place in (root / "raw/youtube/videos", root / "raw/wiki", pages / "lost+found", page):
        place.mkdir(parents=True)
    for file in (root / "raw/youtube/videos/a", pages / "1", pages / "lost+found/x", page / "2"):
        file.touch()
    (root / "raw/wiki/pages").symlink_to(pages)
    (pages / "7").symlink_to(page)
    (page / "link").symlink_to(root / "raw/youtube/videos/a")
    return root


def found(folder: Path, root: Path, **options: bool) -> list[str]:
    return [str(path.relative_to(root)) for path in files_below(folder, root, **options)]


def test_links_to_folders_and_files_are_followed(root: Path) -> None:
    pages = ["raw/wiki/pages/1", "raw/wiki/pages/7/2", "raw/wiki/pages/7/link"]
    assert found(root, root) == [*pages, "raw/youtube/videos/a"]
    assert found(root / "raw/wiki/pages", root) == pages
    assert found(root / "raw/reddit", root) == []


@pytest.mark.parametrize(
    ("link", "target"),
    [
        ("raw/youtube/back", "."),
        ("raw/youtube/back", ".."),
        ("raw/youtube/back", "raw/youtube"),
        ("raw/youtube/back", "raw/wiki"),
        ("raw/youtube/back", "state"),
        ("raw/wiki/pages/7/back", "../third"),
        ("raw/wiki/pages/back", "../disk"),
        ("raw/wiki/same", "../disk/pages"),
        ("raw/wiki/part", "../third/7"),
    ],
)
def test_a_link_that_leads_back_is_named_once(root: Path, link: str, target: str) -> None:
    before = found(root, root)
    (root / "state").mkdir()
    (root / link).symlink_to((root / target).resolve())
    for folder in (root, root / "raw", (root / link).parent):
        with pytest.raises(DamagedData, match="that leads back into the data root") as error:
            found(folder, root)
        assert error.value.hint == "remove the link"
    assert len(found(root, root, strict=False)) == len(before)
    others = [entry.path for _, _, others in walk(root, strict=False) for entry in others]
    assert len(others) == len(before) + 1


@pytest.mark.parametrize("target", ["../unmounted/disk", "itself"])
@pytest.mark.parametrize("link", ["raw", "raw/youtube", "raw/youtube/videos"])
def test_a_link_that_leads_nowhere_is_no_empty_folder(
    tmp_path: Path, link: str, target: str
) -> None:
    place = tmp_path / "data" / link
    place.parent.mkdir(parents=True)
    place.symlink_to(place if target == "itself" else tmp_path / target)
    with pytest.raises(DamagedData, match=f"{place} is a link to .*, which is not there"):
        found(tmp_path / "data/raw/youtube", tmp_path / "data")
    assert found(tmp_path / "data/raw/youtube", tmp_path / "data", strict=False) == []


def test_editors_links_that_lead_nowhere_are_passed_over(root: Path) -> None:
    (root / "raw/youtube/.#notes").symlink_to("somebody@host.1")
    assert "raw/youtube/videos/a" in found(root, root)
