"""`kb verify`: every damaged, missing and foreign file is found, and what can be is mended."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from kb.artifacts import build, manifest
from kb.core.config.pipeline import load, locate
from kb.core.errors import FatalError, UsageError
from kb.core.progress import Silent
from kb.store.tables import parquet
from kb.verify.findings import Findings, VerifyFinding
from kb.verify.repair import Crawl, Make, Step, repaired
from kb.verify.root import verify as look_at
from tests.filters.made import run_at


def verify(folder: Path) -> Findings:
    return look_at(folder, Silent())


def repair(root: Path) -> list[str]:
    said: list[str] = load(str(locate("verify"))).repair(run_at(root))[1]
    return said


def found(folder: Path) -> list[tuple[str, str, str]]:
    """(kind, state, path from the folder) of each finding."""
    return [
        (one.kind, one.state, str(one.path.relative_to(folder))) for one in verify(folder).entries
    ]


def one(root: Path, pattern: str) -> Path:
    return next(iter(sorted(root.glob(pattern))))


def emptied(path: Path) -> None:
    path.write_bytes(b"")


def flipped(path: Path) -> None:
    data = bytearray(path.read_bytes())
    data[len(data) // 2] ^= 4
    path.write_bytes(data)


def test_a_whole_root_is_whole(root: Path) -> None:
    files = [path for path in root.rglob("*") if path.is_file()]
    look = verify(root)
    assert look.entries == []
    rows = {row[0]: row[1] for row in look.table()}
    assert {"raw answers", "state", "tombstones", "clean", "pairs", "release"} <= rows.keys()
    assert look.total("whole")[0] == len(files)
    assert sum(kind["whole"]["files"] for kind in look.summary(root)["kinds"].values()) == len(
        files
    )


def test_keys_restored_tables_and_notes_of_releases_are_known(root: Path) -> None:
    (root / "state/reddit.key").write_text("k")
    (root / "state/reddit.key.sha256").write_text("d")
    shutil.copytree(root / "clean/youtube/videos", root / "restored/youtube/videos")
    noted = pa.table({"table": ["pairs"], "key": [b"1"]})
    for path in (root / "state/releases/pairs/1.0.0.parquet", root / "restored/missing.parquet"):
        path.parent.mkdir(parents=True, exist_ok=True)
        parquet.write(path, noted)
    assert found(root) == []


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


@pytest.mark.parametrize(
    ("pattern", "kind"),
    [
        ("raw/youtube/videos/*.zst", "raw answers"),
        ("clean/youtube/videos/*.parquet", "clean"),
        ("pairs/pairs-*.parquet", "pairs"),
        ("release/youtube", "release"),
    ],
)
def test_what_is_not_there_is_missing(root: Path, pattern: str, kind: str) -> None:
    path = one(root, pattern)
    shutil.rmtree(path) if path.is_dir() else path.unlink()
    assert found(root) == [(kind, "missing", str(path.relative_to(root)))]


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
    ("name", "command"),
    [
        ("export/minedojo/youtube_full.json", "kb youtube export --format minedojo"),
        ("export/minedojo/wiki_full/Cave/0/data.json", "kb wiki export --format minedojo"),
        ("export/convokit/utterances.jsonl", "kb reddit export --format convokit"),
        ("export/video2dataset/clips.parquet", "kb pairs --format video2dataset"),
        ("export/reconstructed/posts/part-00000.parquet", "kb reddit reconstruct"),
        ("report/index.html", "kb report"),
        ("report/figures/words.svg", "kb report"),
    ],
)
def test_of_what_repair_does_not_make_the_table_names_the_command(
    root: Path, name: str, command: str
) -> None:
    path = root / name
    path.parent.mkdir(parents=True, exist_ok=True)
    emptied(path)
    (told,) = verify(root).entries
    assert (told.state, told.advice) == ("damaged", f"run `{command}` again")
    repair(root)
    assert [one.path for one in verify(root).entries] == [path]


def test_a_key_with_two_answers_is_told(root: Path) -> None:
    path = one(root, "clean/youtube/videos/*.parquet")
    shutil.copyfile(path, path.with_name("part-00001.parquet"))
    known = manifest.read(root, "clean/youtube")
    assert known is not None
    known.files["videos/part-00001.parquet"] = manifest.entry_of(path)
    manifest.write(root / "clean/youtube" / manifest.NAME, known)
    (told,) = verify(root).entries
    assert "keys are in two of kept, rejected, failed and pending" in told.what


def test_a_link_to_another_disk_is_read_through(root: Path, tmp_path: Path) -> None:
    shutil.move(root / "clean/youtube", tmp_path / "disk")
    (root / "clean/youtube").symlink_to(tmp_path / "disk")
    assert found(root) == []
    path = one(root, "clean/youtube/videos/*.parquet")
    flipped(path)
    assert found(root) == [("clean", "damaged", str(path.relative_to(root)))]


# -- releases ------------------------------------------------------------------------------------


@pytest.fixture
def folders(released: Path, tmp_path: Path) -> Path:
    """A folder of downloaded releases."""
    return Path(shutil.copytree(released / "release", tmp_path / "down"))


def test_a_downloaded_release_is_whole(folders: Path) -> None:
    look = verify(folders)
    assert look.entries == []
    assert look.total("whole")[0] == sum(path.is_file() for path in folders.rglob("*"))
    assert verify(folders / "reddit").entries == []


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


def test_a_folder_that_is_neither(tmp_path: Path) -> None:
    with pytest.raises(FatalError, match=r"no tables in .*, and it is not a release"):
        verify(tmp_path)
    with pytest.raises(UsageError, match="there is no data root"):
        verify(tmp_path / "nowhere")


# -- repair ---------------------------------------------------------------------------------------


def test_repair_makes_again_what_raw_data_can_make(root: Path) -> None:
    released = one(root, "release/youtube/videos-*.parquet")
    whole = released.read_bytes()
    flipped(released)
    one(root, "clean/youtube/videos/*.parquet").unlink()
    flipped(one(root, "pairs/pairs-*.parquet"))
    emptied(root / "raw/youtube/tombstones.parquet")
    said = repair(root)
    assert found(root) == []
    assert released.read_bytes() == whole
    commands = ("kb youtube filter", "kb pairs --again", "kb youtube export")
    assert all(any(f"`{command}` was run" in line for line in said) for command in commands)
    assert any("is its copy" in line for line in said)


def test_a_release_without_its_description_gets_it_where_nothing_is_damaged(root: Path) -> None:
    """A repair that was killed before it came to the description; the lock's sweep takes the
    temporary files that told of it.
    """
    noted = root / "state/releases/youtube/1.0.0.parquet"
    noted.parent.mkdir(parents=True)
    pq.write_table(pa.table({"table": ["videos"], "key": [b"1"]}), noted)
    assert verify(root).entries == []
    said = load(str(locate("verify", None))).repair(run_at(root))[1]
    assert ["kb release" in line for line in said] == [True]


def test_repair_clears_parts_of_finished_pairs_and_keeps_those_of_others(root: Path) -> None:
    """A repair that was killed behind the last rename of its pairs: nothing of them is damaged."""
    made = manifest.read(root, "pairs")
    assert made is not None
    parts = build.folder_of(root, "pairs", made.inputs, made.rules)
    for name in (parts.name, "going-on"):
        part = root / "state/pairs" / name / "plan.json"
        part.parent.mkdir(parents=True)
        part.write_text("{}")
    load(str(locate("verify", None))).repair(run_at(root))
    assert [path.name for path in (root / "state/pairs").iterdir()] == ["going-on"]


def test_a_repair_killed_after_its_crawl_filters_when_it_is_run_again(root: Path) -> None:
    raw = one(root, "raw/youtube/videos/*.zst")
    whole = raw.read_bytes()
    raw.unlink()
    runs: list[str] = []

    def killed_filter() -> None:
        raise KeyboardInterrupt

    def steps(clean: Callable[[], object]) -> list[Step]:
        crawl = Crawl("youtube", list, lambda: raw.write_bytes(whole))
        folder = (root / "clean/youtube",)
        return [crawl, Make("clean", "kb youtube filter", clean, folder, after="youtube")]

    with pytest.raises(KeyboardInterrupt):
        repaired(root, Silent(), steps(killed_filter))
    for expected in (1, 1):  # the second one finds nothing to do
        repaired(root, Silent(), steps(lambda: runs.append("filter")))
        assert len(runs) == expected
    assert found(root) == []


def test_repair_leaves_a_folder_with_somebody_elses_file(root: Path) -> None:
    mine = root / "clean/youtube/videos/mine.parquet"
    mine.write_text("x")
    gone = one(root, "clean/youtube/videos/part-*.parquet")
    gone.unlink()
    said = repair(root)
    assert any(f"move {mine} away, then run `kb youtube filter`" in line for line in said)
    assert mine.read_text() == "x"
    mine.unlink()
    repair(root)
    assert found(root) == []


def test_repair_says_which_command_asks_where_no_key_is_there(root: Path) -> None:
    path = one(root, "raw/youtube/videos/*.zst")
    flipped(path)
    said = repair(root)
    assert any("was set aside" in line or "set aside as" in line for line in said)
    assert any("`kb youtube crawl` has to be run" in line for line in said)
    assert any(f"{path.name}.damaged-" in name.name for name in path.parent.iterdir())
    (path.parent / "notes.txt").write_text("x")
    told = {(each.state, each.path.name): each.advice for each in verify(root).entries}
    assert told.keys() == {("missing", "youtube"), ("foreign", "notes.txt")}
    assert "kb youtube crawl" in told["missing", "youtube"]


def test_a_damaged_state_is_set_aside(root: Path) -> None:
    path = root / "state/youtube.sqlite"
    path.write_bytes(b"nothing" * 1000)
    assert any("is built again from the raw data" in line for line in repair(root))
    assert (root / "state/youtube.sqlite.damaged").read_bytes() == b"nothing" * 1000
    assert all(kind == "raw answers" for kind, *_ in found(root)) or found(root) == []


# -- the command ----------------------------------------------------------------------------------
