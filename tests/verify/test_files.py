"""Tests of `kb.verify.files`."""

from collections.abc import Callable
from pathlib import Path

import pytest

from tests.verify.conftest import emptied
from tests.verify.test_repair import repair
from tests.verify.test_root import flipped, found, one, verify


@pytest.mark.parametrize(
    ("name", "kind"),
    [
        ("notes.txt", "other"),
        ("raw/youtube/videos/notes.txt", "raw answers"),
        ("raw/other/x/000001-a.ndjson.zst", "raw answers"),
        ("raw/wiki/images/mine.png", "images"),
        ("state/mine.db", "state"),
        ("clean/youtube/videos/mine.parquet", "clean"),
        ("pairs/notes.md", "pairs"),
        ("release/notes.md", "release"),
        ("clean/.youtube.new/videos/part-00000.parquet", "leftovers"),
        ("clean/youtube/videos/.part.parquet.12-3-ab.tmp", "leftovers"),
    ],
)
def test_what_no_command_has_written_is_foreign(root: Path, name: str, kind: str) -> None:
    path = root / name
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text("x")
    assert found(root) == [(kind, "foreign", name)]
    repair(root)
    assert path.exists() == (kind != "leftovers")
    assert bool(found(root)) == (kind != "leftovers")


@pytest.mark.parametrize(
    ("name", "command", "after"),
    [
        ("export/minedojo/youtube_full.json", "kb youtube export --format minedojo", "was made"),
        ("export/minedojo/wiki_full/Cave/0/data.json", "kb wiki export --format minedojo", "fail"),
        ("export/reconstructed/posts/part-00000.parquet", "kb reddit reconstruct", "was set aside"),
        ("report/index.html", "kb report", "was made"),
        ("report/figures/words.svg", "kb report", "was made"),
    ],
)
def test_the_table_names_the_command_and_repair_runs_it_where_it_can(
    root: Path, name: str, command: str, after: str
) -> None:
    path = root / name
    path.parent.mkdir(parents=True, exist_ok=True)
    emptied(path)
    (told,) = verify(root).entries
    assert (told.state, told.advice) == ("damaged", f"run `{command}` again")
    said = repair(root)
    assert [line for line in said if after in line], said
    assert [each.path for each in verify(root).entries] == ([path] if after == "fail" else [])


FILES = {
    "raw/youtube/videos/*.zst": "raw answers",
    "raw/youtube/tombstones.parquet": "tombstones",
    "state/youtube.sqlite": "state",
    "clean/youtube/videos/*.parquet": "clean",
    "clean/youtube/rejected/*.parquet": "clean",
    "clean/youtube/_manifest.json": "clean",
    "pairs/pairs-*.parquet": "pairs",
    "release/youtube/videos-*.parquet": "release",
}


@pytest.mark.parametrize("pattern", FILES)
@pytest.mark.parametrize("damage", [emptied, flipped])
def test_damage_is_found_wherever_it_is(
    root: Path, pattern: str, damage: Callable[[Path], None]
) -> None:
    path = one(root, pattern)
    if path.suffix == ".json":
        path.write_bytes(path.read_bytes()[:-9])
    elif path.suffix == ".sqlite" and damage is flipped:
        path.write_bytes(path.read_bytes()[:4096] + bytes(8192))
    else:
        damage(path)
    look = verify(root)
    assert [(each.kind, each.state, each.path) for each in look.entries] == [
        (FILES[pattern], "damaged", path)
    ]
    assert look.entries[0].advice
