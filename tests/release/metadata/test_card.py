"""The first screen of a card: what it tells to type works as it stands, in the folder itself."""

import glob
import re
import shutil
import subprocess
from pathlib import Path
from typing import Any

import pyarrow.dataset
import pyarrow.parquet as pq
import pytest
from PIL import Image

from kb import __version__
from kb.cli.app import leaves
from kb.core.sources import BY_DEFAULT, SOURCES
from kb.export import wiki_tar
from kb.release.build import release
from kb.release.metadata.card import size_category
from tests.release.conftest import a_run
from tests.release.made import build, rows


def card(released: Path, source: str) -> str:
    return (released / "release" / source / "README.md").read_text(encoding="utf-8")


def blocks(text: str, language: str) -> list[str]:
    return re.findall(rf"^```{language}\n(.*?)^```", text, re.MULTILINE | re.DOTALL)


@pytest.mark.parametrize("source", BY_DEFAULT)
def test_install_command_query_and_picture_come_first(released: Path, source: str) -> None:
    text = card(released, source)
    screen = text[text.index("\n# ") : text.index("|  |  |")]
    assert screen.count("\n") < 45
    assert f"Lorecrawl {__version__} (lock file SHA-256 " in screen
    assert "run `make setup` in the checkout of Lorecrawl, or `pip install -e " in screen
    assert blocks(screen, "sh")[0].startswith("kb verify .")
    assert ("\nkb restore ." in screen) == (source not in ("wiki", "tasks", "links"))
    (picture,) = blocks(screen, "text")
    assert "█" in picture
    names = {name for name, _ in leaves()}
    for command in re.findall(r"^kb ([a-z]+)", screen, re.MULTILINE):
        assert command in names


def with_pictures(root: Path) -> Path:
    """A release of the wiki whose pictures are some."""
    build(root, sources=("wiki",))
    for name in ("pages", "images"):
        for row in pq.read_table(root / "clean" / "wiki" / name).to_pylist():
            size = (row["page_width"], row["page_height"]) if name == "pages" else (16, 16)
            path = row.get("screenshot_path") or row.get("path")
            if path:
                Image.new("RGB", size).save(root / path, "PNG")
    wiki_tar.export(a_run(root))
    release(a_run(root))
    return root


@pytest.mark.parametrize("source", BY_DEFAULT)
def test_the_python_of_the_first_screen_and_of_the_archives_runs(
    released: Path, source: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    if source == "wiki":
        released = with_pictures(tmp_path / "wiki")
    folder = shutil.copytree(released / "release" / source, tmp_path / "folder")
    monkeypatch.chdir(folder)
    text = card(released, source)
    examples = [block for block in blocks(text, "python") if "THIS_FOLDER" not in block]
    assert len(examples) == 1 + (source == "wiki")
    for example in examples:
        names: dict[str, Any] = {}
        exec(example, names)
    (tars,) = [line for line in text.splitlines() if line.startswith("tar ")] or [""]
    if tars:
        subprocess.run(tars.partition("#")[0].split(), check=True, capture_output=True)
    assert bool(tars) == (source == "wiki")


def test_the_line_for_pyarrow_reads_every_shard(released: Path) -> None:
    text = card(released, "youtube")
    (line,) = [line for line in text.splitlines() if line.startswith("pyarrow.dataset.")]
    folder = released / "release" / "youtube"
    assert len(list(folder.glob("videos-*.parquet"))) > 1
    found = eval(line.replace("THIS_FOLDER", str(folder)), {"glob": glob, "pyarrow": pyarrow})
    assert found.num_rows == len(rows()["youtube/videos"])


def test_the_stages_are_those_of_the_pipelines(released: Path) -> None:
    contract = {
        "youtube": "missing, topic, views, aspect_ratio, duration, age_restricted, toxicity,"
        " transcript",
        "wiki": "missing, robots, render, words, toxicity",
    }
    for source, stages in contract.items():
        assert ", ".join(SOURCES[source].stages) == stages
    stages = set(SOURCES["reddit"].stages)
    assert stages == {
        "missing",
        "removed",
        "nsfw",
        "score",
        "toxicity",
        "post",
    }
    (picture,) = blocks(card(released, "reddit"), "text")[:1]
    left = [int(line.split()[-2].replace(",", "")) for line in picture.splitlines()]
    assert left == sorted(left, reverse=True)


def test_no_text_points_below_where_nothing_is(released: Path) -> None:
    for source in BY_DEFAULT:
        deposit = (released / "release" / source / "zenodo.json").read_text(encoding="utf-8")
        assert " below" not in deposit


def test_screenshots_that_pillow_refuses_are_counted(tmp_path: Path) -> None:
    def edit(name: str, rows: list[dict[str, Any]]) -> None:
        if name == "wiki/pages":
            rows[0] |= {"page_width": 1280, "page_height": 50_000, "device_pixel_ratio": 2.0}
            rows[1] |= {"page_width": 1280, "page_height": 50_000, "device_pixel_ratio": 1.0}

    root = build(tmp_path, edit, sources=("wiki",))
    release(a_run(root))
    assert "- 1 screenshot has more than 179.0 megapixels" in card(root, "wiki")


@pytest.mark.parametrize(
    ("count", "category"),
    [
        *((0, "n<1K"), (999, "n<1K"), (1_000, "1K<n<10K"), (99_999_999, "10M<n<100M")),
        *((100_000_000, "100M<n<1B"), (10**12, "n>1T"), (10**14, "n>1T")),
    ],
)
def test_size_categories_are_the_hubs(count: int, category: str) -> None:
    assert size_category(count) == category
