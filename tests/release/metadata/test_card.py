"""The first screen of a card: what it tells to type works as it stands, in the folder itself."""

import glob
import json
import re
from itertools import pairwise
from pathlib import Path
from typing import Any

import duckdb
import pyarrow.dataset
import pytest
from jinja2 import UndefinedError
from markdown_it import MarkdownIt

from kb.cli.app import leaves
from kb.core.licences import KNOWN
from kb.core.sources import BY_DEFAULT, SOURCES
from kb.release.metadata.card import size_category
from kb.release.metadata.templates import render
from kb.version import __version__
from tests.recipes import release
from tests.release.conftest import a_run
from tests.release.made import build, rows
from tests.release.signed import LICENCES, SIGNED


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


def test_the_lines_for_python_read_every_shard(
    released: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(released / "release" / "youtube")
    (line,) = re.findall(r"^files = (.*)", card(released, "youtube"), re.MULTILINE)
    files = eval(line, {"glob": glob})
    assert len(files) > 1
    assert pyarrow.dataset.dataset(files).count_rows() == len(rows()["youtube/videos"])


def test_the_stages_are_those_of_the_pipelines(released: Path) -> None:
    contract = {
        "youtube": "missing, not_public, topic, views, aspect_ratio, duration, age_restricted,"
        " toxicity, transcript",
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


HOSTILE = (
    "Free\n\n# Owned\n<script>alert(1)</script> | x | [here](https://evil.example) `code`"
    " *now*\u2028---"
)


def test_words_of_the_data_are_never_markup_nor_lines(tmp_path: Path) -> None:
    """A licence is what a wiki's file page says, a title and a name what a profile says."""

    def edit(name: str, made: list[dict[str, Any]]) -> None:
        if name == "wiki/images":
            made[0]["license"], made[1]["license"] = HOSTILE, "plain_words"

    profile = tmp_path / "mine.toml"
    profile.write_text(
        f'name = "mine"\ntitle = {json.dumps(HOSTILE)}\n[release]\ncontact ='
        f" {json.dumps(HOSTILE)}\n"
        f"creators = [{{ name = {json.dumps(HOSTILE)} }}]\n{LICENCES}"
    )
    release(a_run(build(tmp_path, edit, ("wiki",)), profile))
    folder = tmp_path / "release" / "wiki"
    law = (folder / "LICENSE").read_text()
    assert "\n# Owned" not in law
    assert len([line for line in law.splitlines() if "alert(1)" in line]) == 1
    for name in ("README.md", "DATASHEET.md"):
        text = (folder / name).read_text()
        text = text[text.index("\n# ") :] if name == "README.md" else text  # YAML comes first
        page = MarkdownIt("commonmark").enable("table").parse(text)
        inside = [token for block in page for token in block.children or ()]
        assert not [token for token in (*page, *inside) if token.type.startswith("html")]
        links = [str(token.attrs["href"]) for token in inside if token.type == "link_open"]
        assert not [link for link in links if "evil" in link]
        headings = [after.content for token, after in pairwise(page) if token.tag == "h1"]
        assert "Owned" not in headings
        # Shown as they were written, in one piece: in the title, and in the table of licences.
        words = [block for block in page if "alert(1)" in block.content and block.children]
        seen = ["".join(token.content for token in block.children or ()) for block in words]
        assert any("<script>alert(1)</script> | x | [here]" in said for said in seen)
        assert "plain_words" in text
    said = MarkdownIt("commonmark").parse((folder / "README.md").read_text())
    fence = next(token for token in said if token.info == "bibtex")
    assert fence.content.count("\n") == 6


def test_a_template_with_an_unknown_name_fails() -> None:
    with pytest.raises(UndefinedError, match="'about' is undefined"):
        render("licence.txt", law=KNOWN["CC0-1.0"], facts=None)


def test_licences_of_a_wiki_whose_rows_name_several(tmp_path: Path) -> None:
    def edit(name: str, made: list[dict[str, Any]]) -> None:
        if name == "wiki/images":
            made[0]["license"], made[1]["license"] = "CC0-1.0", "all rights reserved"
        if name == "wiki/pages":
            for row in made:
                row["license"] = "CC-BY-SA-4.0"

    release(a_run(build(tmp_path, edit, ("wiki",))))
    folder = tmp_path / "release" / "wiki"
    assert json.loads((folder / "zenodo.json").read_text())["metadata"]["license"] == "cc-by-sa-4.0"
    assert KNOWN["CC-BY-SA-4.0"].text in (folder / "LICENSE").read_text()
    assert [path.name for path in folder.glob("LICENSE-*")] == ["LICENSE-CC0-1.0.txt"]
    assert "all rights reserved (1 rows)" in (folder / "LICENSE").read_text()


def test_wiki_that_names_no_licence_takes_the_profiles(tmp_path: Path) -> None:
    def edit(name: str, made: list[dict[str, Any]]) -> None:
        for row in made if name == "wiki/pages" else []:
            row["license"] = None

    profile = tmp_path / "mine.toml"
    profile.write_text(
        f'name = "mine"\ntitle = "Mine"\n[release]\n{SIGNED}'
        '[release.licenses]\nwiki = "CC-BY-NC-SA-3.0"\n'
    )
    release(a_run(build(tmp_path, edit, ("wiki",)), profile))
    assert "CC-BY-NC-SA-3.0" in (tmp_path / "release" / "wiki" / "LICENSE").read_text()


SECTION = {
    "videos_with_both_tracks": 6120,
    "videos_compared": 198,
    "keywords": {
        "in_automatic": 7000,
        "in_manual": 7500,
        "manual_given_automatic": {"n": 7000, "share": 0.95, "low": 0.9446, "high": 0.9549},
        "automatic_given_manual": {"n": 7500, "share": 0.8867, "low": 0.8793, "high": 0.8937},
    },
    "automatic_later_s": {"n": 6650, "p25": -0.21, "p50": 0.1, "p75": 0.43},
}


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    root = build(tmp_path_factory.mktemp("quality"), sources=("pairs",))
    (root / "pairs").mkdir(exist_ok=True)
    (root / "pairs" / "measures.json").write_text(json.dumps({"speech_recognition": SECTION}))
    release(a_run(root))
    return root / "release" / "pairs"


def test_card_and_datasheet_give_the_figures_of_the_tables(folder: Path) -> None:
    total, words, verbs, english, recurring = duckdb.sql(f"""
        SELECT count(*), count(*) FILTER (timing = 'word'), count(*) FILTER (has_verb),
            count(*) FILTER (language = 'en'), count(*) FILTER (recurring_share > 0.5)
        FROM '{folder}/pairs-*.parquet' JOIN '{folder}/quality-*.parquet' USING (pair_id)
        """).fetchall()[0]
    assert 0 < words < total
    assert 0 < verbs < total
    for name in ("README.md", "DATASHEET.md"):
        text = " ".join((folder / name).read_text(encoding="utf-8").split())
        assert "How good are these pairs" in text
        for what, count in (
            ("Times", words),
            ("Near-duplicates", 0),
            ("Recurring text: in", recurring),
            ("Languages", english),
            ("Verbs", verbs),
        ):
            said = f"{what.partition(':')[0]}:{what.partition(':')[2]} {count} of {total} pairs"
            assert said in text, said
        assert "in 198 of 6,120 videos that have both tracks" in text
        assert "has 95.0% (95 % interval 94.5% to 95.5%, n = 7,000) of the keywords" in text
        assert "88.7% (95 % interval 87.9% to 89.4%, n = 7,500) of those" in text
        assert "between -0.21 and 0.43 s later" in text
        assert "they do not say whether the clip shows what the text names" in text
