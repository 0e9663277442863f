"""Raw answers and extractions by hand, filtered: every page one answer, the newest answer wins."""

import hashlib
import json
from pathlib import Path
from typing import Any

import pyarrow.parquet as pq
import pytest
import zstandard

from kb.core.config.profile import load_profile
from kb.core.config.settings import load_settings
from kb.core.context import Run
from kb.core.errors import DamagedData, FatalError
from kb.filters.filter_run import run_clean
from kb.store.state import tombstones
from kb.store.tables import partition
from tests.wiki.handmade_data import (
    FRIDAY,
    MONDAY,
    PICTURE,
    TUESDAY,
    WORDS,
    captured,
    many,
    page,
    put,
    refused,
    told,
)


def run_at(root: Path, **options: Any) -> Run:
    profile = load_profile("minecraft")
    assert profile.wiki is not None
    long = profile.wiki.model_copy(update={"min_words": 20})
    off = profile.toxicity.model_copy(update={"toxicity": "off"})
    return Run(
        load_settings(dotenv=False),
        profile.model_copy(update={"toxicity": off, "wiki": long}),
        root,
        **{"workers": 1, **options},
    )


def rows(root: Path, name: str) -> list[dict[str, Any]]:
    return pq.read_table(root / "clean/wiki" / name).to_pylist()


def verdicts(root: Path) -> dict[str, tuple[Any, ...]]:
    """stage, reason, value and threshold by key; a pending page's reason alone."""
    found = {
        row["key"]: tuple(row[name] for name in ("stage", "reason", "value", "threshold"))
        for row in rows(root, "rejected")
    }
    return found | {row["key"]: (row["reason"],) for row in rows(root, "pending")}


def titles(root: Path) -> dict[int, str]:
    return {row["page_id"]: row["title"] for row in rows(root, "pages")}


@pytest.fixture
def root(tmp_path: Path) -> Path:
    """One page an answer."""
    root = tmp_path / "data"
    general = {"server": "//wiki.example", "script": "/w/index.php"}
    put(
        root,
        "site",
        (
            MONDAY,
            {
                "query": {
                    "general": general,
                    "rightsinfo": {"url": "https://creativecommons.org/licenses/by-sa/4.0/"},
                }
            },
        ),
    )
    absent = [
        {"ns": 0, "title": "Nowhere", "missing": True},
        {"title": "Bad[", "invalid": True},
        page(90, "Elsewhere", redirect=True),
    ]
    names = ["Kept", "Hidden", "Broken", "Waiting", "Short"]
    put(
        root,
        "pages",
        (MONDAY, told(*(page(number, name) for number, name in enumerate(names, 1)), *absent)),
    )
    put(
        root,
        "renders",
        (MONDAY, captured(root, 1, "Kept")),
        (MONDAY, refused(2, "Hidden", "robots", "disallowed")),
        (MONDAY, refused(3, "Broken", "final", "too_tall", 123456)),
        (MONDAY, captured(root, 5, "Short", text="Too short")),
    )
    stored = {
        "sha256": "ab",
        "path": "raw/wiki/images/ab.png",
        "media_type": "image/png",
        "width": 3,
        "height": 2,
        "license": None,
        "frames": [],
    }
    put(root, "files", (MONDAY, {"key": PICTURE, "outcome": "stored", "url": PICTURE, **stored}))
    return root


def test_every_page_has_one_answer(root: Path) -> None:
    summary = run_clean(run_at(root), "wiki")
    assert verdicts(root) == {
        "Nowhere": ("missing", "missing", None, None),
        "Bad[": ("missing", "invalid", None, None),
        "Elsewhere": ("missing", "redirect", None, None),
        "2": ("robots", "disallowed", "http://wiki.example/wiki/Hidden", None),
        "3": ("render", "too_tall", "123456", None),
        "4": ("render",),
        "5": ("words", "below", "3", "20"),
    }
    assert titles(root) == {1: "Kept"}
    names = ("crawled", "kept", "rejected", "failed", "pending", "missing")
    assert {name: summary[name] for name in names} == {
        "crawled": 8, "kept": 1, "rejected": 6, "failed": 0, "pending": 1, "missing": 3,
    }  # fmt: skip
    assert summary["stages"] == {"missing": 3, "render": 1, "robots": 1, "words": 1}
    assert summary["tables"] == {
        "wiki/pages": 1,
        "wiki/elements": 4,
        "wiki/cells": 1,
        "wiki/images": 1,
        "wiki/facts": 0,
        "wiki/recipes": 0,
        "wiki/page_text": 1,
        "wiki/page_links": 0,
        "wiki/categories": 0,
        "wiki/redirects": 0,
        "wiki/recipe_edges": 0,
    }


def test_a_kept_page_has_its_tables(root: Path) -> None:
    run_clean(run_at(root), "wiki")
    (kept,) = rows(root, "pages")
    assert (kept["license"], kept["word_count"], kept["page_height"]) == (
        "CC-BY-SA-4.0",
        len(WORDS.split()) + 1,
        2000,
    )
    assert kept["contributors_url"] == "http://wiki.example/w/index.php?title=Kept&action=history"
    assert kept["screenshot_path"] == "raw/wiki/pages/1/1/screenshot.png"
    assert kept["settled"] is False
    assert [(row["kind"], row["text"], row["reading_order"]) for row in rows(root, "elements")] == [
        ("text", WORDS, 0),
        ("image", None, 1),
        ("table", None, 2),
        ("cell", "hot", 3),
    ]
    (image,) = rows(root, "images")
    assert (image["path"], image["alt_text"], image["frame_index"]) == (
        "raw/wiki/images/ab.png",
        "A kiln",
        None,
    )


def test_lines_facts_and_recipes_of_a_page(root: Path) -> None:
    item = dict.fromkeys(("tip", "title", "label", "text", "quantity")) | {"absent": False}
    slot = {"output": True, "row": 0, "column": 0, "visible": True, "element": 1}
    things = [{**item, "alt": "Jar", "filled": True}, {**item, "alt": None, "filled": False}]
    fact = {"subject": None, "field": "Weight:", "value": "2 kg", "visible": False, "element": 3}
    more = {
        "facts": [{**fact, "value": ""}, fact],
        "recipes": [{"slots": [{**slot, "items": things}]}],
    }
    lines = [[0, 1, 2, 3], [0, 4, 1.5, 3]]
    put(root, "pages", (FRIDAY, told(page(1, "Kept", 2))))
    put(root, "renders", (FRIDAY, captured(root, 1, "Kept", 2, lines=lines, more=more)))
    run_clean(run_at(root), "wiki")
    sides = ("x", "y", "width", "height")
    assert [row["lines"] for row in rows(root, "elements")] == [
        [dict(zip(sides, line, strict=True)) for line in lines],
        *[None] * 3,
    ]
    assert rows(root, "facts") == [
        {
            "page_id": 1,
            "fact_id": 0,
            "subject": "Kept",
            "field": "Weight",
            "value": "2",
            "unit": "kg",
            "element_id": 3,
            "visible": False,
            "revision_id": 2,
        }
    ]
    assert [
        (row["role"], row["alternative"], row["item"], row["quantity"], row["revision_id"])
        for row in rows(root, "recipes")
    ] == [("output", 0, "Jar", 1, 2), ("output", 1, None, None, 2)]


def test_an_icon_bears_the_name_inside_of_its_picture_s_text(root: Path) -> None:
    captured(root, 1, "Kept")
    path = root / "raw/wiki/pages/1/1/extraction.json.zst"
    seen = json.loads(zstandard.ZstdDecompressor().decompress(path.read_bytes()))
    told = "ItemSprite emerald.png: Sprite image for emerald in Minecraft"
    seen["elements"] += [
        {**seen["elements"][1], "id": 4 + n, "kind": "sprite", "text": text}
        for n, text in enumerate((told, "Clay", None))
    ]
    path.write_bytes(zstandard.ZstdCompressor().compress(json.dumps(seen).encode()))
    run_clean(run_at(root), "wiki")
    assert [row["text"] for row in rows(root, "elements")][4:] == ["emerald", "Clay", None]


def test_the_newest_answer_wins(root: Path) -> None:
    # A new revision waits for its capture; a refused page is captured; an absent title gets a page;
    # a redirect too.
    put(
        root, "pages", (FRIDAY, told(page(1, "Kept", 7), page(6, "Nowhere"), page(90, "Elsewhere")))
    )
    put(
        root,
        "renders",
        (FRIDAY, captured(root, 3, "Broken")),
        (FRIDAY, captured(root, 6, "Nowhere")),
        (FRIDAY, captured(root, 90, "Elsewhere")),
    )
    # Segments of another machine may come later and say what was before.
    put(
        root,
        "pages",
        (TUESDAY, told(page(1, "Kept", 3), {"ns": 0, "title": "Nowhere", "missing": True})),
    )
    put(root, "renders", (TUESDAY, captured(root, 1, "Kept", 3)))
    summary = run_clean(run_at(root), "wiki")
    assert titles(root) == {3: "Broken", 6: "Nowhere", 90: "Elsewhere"}
    assert verdicts(root)["1"] == ("render",)
    assert {"Nowhere", "Elsewhere", "3", "6"}.isdisjoint(verdicts(root))
    assert (
        summary["duplicates"] == 6
    )  # of pages 1 (two) and 90, of titles Nowhere (two) and Elsewhere


def test_pages_that_went_away_leave_the_tables(root: Path) -> None:
    put(root, "pages", (FRIDAY, told({"pageid": 1, "missing": True}, page(5, "Shorter", 2))))
    put(root, "renders", (FRIDAY, captured(root, 5, "Shorter", 2)))
    run_clean(run_at(root), "wiki")
    assert titles(root) == {5: "Shorter"}
    assert {"1", "Kept"}.isdisjoint(verdicts(root))


def test_tombstones_name_a_page_by_id_or_title(root: Path) -> None:
    put(root, "pages", (MONDAY, told(page(7, "Purged"))))
    put(root, "renders", (MONDAY, captured(root, 7, "Purged")))
    tombstones.add_tombstones(
        root, "wiki", [("1", "named"), ("Purged", "named"), ("Nowhere", "moved")]
    )
    for name in ("1", "7"):  # purge takes the captured files as well
        (root / f"raw/wiki/pages/{name}/1/extraction.json.zst").unlink()
    assert run_clean(run_at(root), "wiki")["crawled"] == 6
    assert titles(root) == {}
    assert {"1", "7", "Purged", "Nowhere"}.isdisjoint(verdicts(root))


def test_buckets_and_workers_change_no_row(
    root: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    many(root, 60)
    names = ("pages", "elements", "cells", "images", "facts", "recipes", "rejected", "pending")
    run_clean(run_at(root), "wiki")
    whole = {name: rows(root, name) for name in names}
    monkeypatch.setattr(partition, "RAW_BYTES", 100_000)
    run_clean(run_at(root), "wiki")
    assert len(list((root / "clean/wiki/pages").iterdir())) > 8
    for name in names:
        assert sorted(map(str, rows(root, name))) == sorted(map(str, whole[name]))
    before = digests(root / "clean")
    run_clean(run_at(root, workers=2), "wiki")
    assert digests(root / "clean") == before


def digests(folder: Path) -> dict[str, str]:
    return {
        str(path.relative_to(folder)): hashlib.sha256(path.read_bytes()).hexdigest()
        for path in sorted(folder.rglob("*"))
        if path.is_file()
    }


def test_a_lost_extraction_names_its_file_and_replaces_nothing(root: Path) -> None:
    run_clean(run_at(root), "wiki")
    before = digests(root / "clean")
    (root / "raw/wiki/pages/1/1/extraction.json.zst").write_bytes(b"nothing")
    with pytest.raises(DamagedData, match=r"pages/1/1/extraction.json.zst can't be read"):
        run_clean(run_at(root), "wiki")
    assert digests(root / "clean") == before


def test_a_crawl_that_asked_no_page_yet_is_nothing_to_filter(tmp_path: Path) -> None:
    put(tmp_path, "site", (MONDAY, {"query": {"general": {}}}))
    with pytest.raises(FatalError, match="nothing to filter"):
        run_clean(run_at(tmp_path), "wiki")
    assert not (tmp_path / "clean/wiki").exists()
