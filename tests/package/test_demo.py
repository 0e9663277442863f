"""`kb demo` of the installed wheel, outside of the checkout: the whole job, and nothing left out."""

from __future__ import annotations

import json
from pathlib import Path

STEPS = ["youtube crawl", "youtube filter", "youtube export", "wiki crawl", "wiki filter", "wiki export",
         "reddit crawl", "reddit import", "refresh reddit", "reddit filter", "reddit export", "reddit reconstruct", "pairs", "release", "report"]


def summary(demo: Path) -> dict[str, object]:
    return json.loads((demo / "demo.out").read_text().splitlines()[-1])


def test_every_step_was_done(demo: Path) -> None:
    done = summary(demo)
    for step in STEPS:
        assert step in done, step
        assert "left_out" not in done[step], done[step]


def test_nothing_is_lost_on_the_way(demo: Path) -> None:
    done = summary(demo)
    for source in ("youtube", "wiki", "reddit"):
        found = done[f"{source} filter"]
        assert found["crawled"] == found["kept"] + found["rejected"] + found["failed"] + found["pending"]
        assert (found["failed"], found["pending"]) == (0, 0)
        assert found["kept"] > 0
        assert found["rejected"] > 0


def test_it_leaves_what_the_contract_says(demo: Path) -> None:
    root = demo / "data" / "demo"
    for source in ("youtube", "wiki", "reddit"):
        for folder in ("raw", "clean", "annotations", "release"):
            assert any((root / folder / source).rglob("*.*")), f"{folder}/{source}"
        assert (root / "state" / f"{source}.sqlite").is_file()
    for source in ("youtube", "wiki", "reddit", "pairs"):
        for name in ("README.md", "croissant.json", "zenodo.json", "SHA256SUMS", "LICENSE", "CITATION.cff", "DATASHEET.md"):
            assert (root / "release" / source / name).is_file(), f"release/{source}/{name}"
    assert (root / "report" / "index.html").is_file()
    assert [path.name for path in demo.iterdir() if not path.name.startswith(("demo.", "."))] == ["data"], "nothing else beside the data"


def test_it_prints_queries_with_results(demo: Path) -> None:
    out = (demo / "demo.out").read_text()
    assert out.count("SELECT") >= 3
    assert "Traceback" not in (demo / "demo.err").read_text()
