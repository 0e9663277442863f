"""Tests of `kb.verify.root`."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from kb.verify.findings import VerifyFinding
from tests.verify.test_root import flipped, found, one, verify


def _croissant(folder: Path) -> None:
    path = folder / "croissant.json"
    said = json.loads(path.read_text())
    next(one for one in said["distribution"] if "sha256" in one)["sha256"] = "0" * 64
    path.write_text(json.dumps(said))


def _strange(folder: Path) -> None:
    (folder / "extra.csv").write_text("x")


RELEASES: dict[str, tuple[Callable[[Path], Any], set[tuple[str, str]]]] = {
    "bit": (
        lambda folder: flipped(one(folder, "posts-*.parquet")),
        {("damaged", "posts-00000-of-00001.parquet")},
    ),
    "gone": (lambda folder: (folder / "LICENSE").unlink(), {("missing", "LICENSE")}),
    "no sums": (lambda folder: (folder / "SHA256SUMS").unlink(), {("missing", "SHA256SUMS")}),
    "bad sums": (
        lambda folder: (folder / "SHA256SUMS").write_text("x\n"),
        {("damaged", "SHA256SUMS")},
    ),
    "more": (_strange, {("foreign", "extra.csv")}),
    "metadata": (_croissant, {("damaged", "croissant.json")}),
}


@pytest.mark.parametrize("name", RELEASES)
def test_a_release_that_is_not_what_was_published(folders: Path, name: str) -> None:
    change, expected = RELEASES[name]
    change(folders / "reddit")
    for folder in (folders, folders / "reddit"):
        told: list[VerifyFinding] = verify(folder).entries
        assert {(each.state, each.path.name) for each in told} == expected
        assert all(each.advice for each in told)


def test_a_shard_that_its_neighbours_speak_of(folders: Path) -> None:
    folder = folders / "youtube"
    (folder / "SHA256SUMS").unlink()
    one(folder, "videos-*.parquet").rename(folder / "videos-00001-of-00002.parquet")
    assert found(folder) == [
        ("release", "missing", "SHA256SUMS"),
        ("release", "missing", "videos-00000-of-00002.parquet"),
    ]
