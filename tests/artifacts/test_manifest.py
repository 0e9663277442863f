"""Files of tables that were deleted: named, never taken for fewer rows."""

import os
import shutil
from dataclasses import replace
from pathlib import Path

import pyarrow.parquet as pq
import pytest

from kb.artifacts import freshness, manifest
from kb.artifacts.makers import make_and_export
from kb.core.errors import DamagedData, KbError, ReleaseRefused
from kb.export import layouts, minedojo
from kb.filters.filter_run import run_clean
from kb.query import connect
from kb.release.build import exported
from kb.store import lock
from kb.store.artifact_registry import MANIFEST
from kb.store.tables.checksums import digest
from kb.store.tables.parquet import read_table
from kb.store.tables.shard_writer import write_table
from tests.filters import full_root
from tests.filters.made import run_at
from tests.recipes import release


@pytest.fixture(scope="module")
def base(tmp_path_factory: pytest.TempPathFactory) -> Path:
    root = tmp_path_factory.mktemp("complete") / "data"
    full_root.make(root)
    return root


@pytest.fixture
def root(base: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(base, tmp_path / "data"))


def one(folder: Path) -> Path:
    return next(path for path in sorted(folder.glob("*.parquet")))


def pairs(root: Path, **options: bool) -> object:
    return make_and_export(replace(run_at(root), **options), "pairs")


READERS = {
    "export": lambda root: layouts.write_parquet(run_at(root), "youtube"),
    "minedojo": lambda root: minedojo.youtube(run_at(root)),
    "pairs": pairs,
    "query": connect,
}


@pytest.mark.parametrize("name", READERS)
@pytest.mark.parametrize("whole", [False, True])
def test_a_deleted_clean_file_or_table_is_one_line(root: Path, name: str, whole: bool) -> None:
    folder = root / "clean/youtube/videos"
    gone = one(folder)
    released = {path.name: path.read_bytes() for path in root.glob("release/*/*")}
    if whole:
        shutil.rmtree(folder)
    else:
        gone.unlink()
    with pytest.raises(DamagedData) as told:
        READERS[name](root)
    assert f"{gone} is missing" in str(told.value)
    assert told.value.hint == "run `kb youtube filter` again"
    assert released == {path.name: path.read_bytes() for path in root.glob("release/*/*")}
    run_clean(run_at(root), "youtube")
    READERS[name](root)


def test_a_source_that_was_never_filtered_is_no_damage(tmp_path: Path) -> None:
    assert manifest.rows(tmp_path, "youtube/videos") == []


@pytest.mark.parametrize("content", ["", "[]", '{"files": 3}', "{"])
def test_a_damaged_manifest_is_an_error(root: Path, content: str) -> None:
    (root / "clean/youtube/_manifest.json").write_text(content)
    with pytest.raises(DamagedData, match=r"_manifest.json can't be read") as told:
        layouts.write_parquet(run_at(root), "youtube")
    assert told.value.hint == "run `kb youtube filter` again"


def test_pairs_that_lost_a_shard_are_made_again(root: Path) -> None:
    folder = root / "pairs"
    whole = {path.name: path.read_bytes() for path in folder.glob("*.parquet")}
    for lose in (Path.unlink, lambda path: path.rename(folder / "pairs-00001-of-00002.parquet")):
        lose(one(folder))
        with pytest.raises(DamagedData, match="is missing") as told:
            layouts.write_parquet(run_at(root), "pairs")
        assert told.value.hint == "run `kb pairs --again`"
        pairs(root)
        assert whole == {path.name: path.read_bytes() for path in folder.glob("*.parquet")}


def test_a_missing_release_folder_is_never_passed_over(root: Path) -> None:
    shutil.rmtree(root / "release/youtube")
    with pytest.raises(ReleaseRefused) as told:
        release(run_at(root))
    (line,) = told.value.problems
    assert line.startswith(f"missing: {root}/release/youtube: was exported and is not there")
    assert "run `kb youtube export`" in line
    assert [folder.source for folder in exported(run_at(root), ["pairs"])] == ["pairs"]
    (root / "release/youtube").mkdir()
    (root / "release/youtube/SHA256SUMS").write_text("")
    with pytest.raises(ReleaseRefused, match="for 1 reason"):
        exported(run_at(root))
    layouts.write_parquet(run_at(root), "youtube")
    assert [folder.source for folder in exported(run_at(root))] == ["youtube", "pairs"]
    with pytest.raises(KbError, match="there is no folder wiki"):
        exported(run_at(root), ["wiki"])


def test_a_release_without_a_shard_is_refused(root: Path) -> None:
    one(root / "release/pairs").rename(root / "release/pairs/pairs-00001-of-00002.parquet")
    with pytest.raises(ReleaseRefused) as told:
        release(run_at(root), ["pairs"])
    assert any("shards are missing" in line for line in told.value.problems)


def test_a_link_to_a_folder_stays_one(root: Path, tmp_path: Path) -> None:
    """Clean tables on another disk: every filter replaces what the link leads to."""
    elsewhere = tmp_path / "disk"
    shutil.move(root / "clean/youtube", elsewhere)
    (root / "clean/youtube").symlink_to(elsewhere)
    for _ in range(3):
        (elsewhere / "videos/old.parquet").write_bytes(b"of before")
        run_clean(run_at(root), "youtube")
        assert (root / "clean/youtube").is_symlink()
        assert (root / "clean/youtube").resolve() == elsewhere
        assert not (elsewhere / "videos/old.parquet").exists()
        assert sorted(path.name for path in tmp_path.iterdir()) == ["data", "disk"]
    layouts.write_parquet(run_at(root), "youtube")
    (tmp_path / ".disk.new").mkdir()
    (elsewhere / "videos/.left.tmp").touch()
    with lock.taking(root, *lock.of_clean("youtube")):
        assert not (tmp_path / ".disk.new").exists()
        assert not (elsewhere / "videos/.left.tmp").exists()


def test_a_link_that_an_earlier_version_replaced_is_no_obstacle(root: Path, tmp_path: Path) -> None:
    (tmp_path / "disk").mkdir()
    (root / "clean/.youtube.old").symlink_to(tmp_path / "disk")
    run_clean(run_at(root), "youtube")
    assert sorted(path.name for path in (root / "clean").iterdir()) == ["youtube"]


def test_the_manifest_names_inputs_and_files_with_digest_and_rows(root: Path) -> None:
    found = manifest.read_manifest(root, "clean/youtube")
    assert found is not None
    assert (found.artifact, found.command) == ("clean/youtube", "kb youtube filter")
    assert found.inputs == manifest.inputs(root, "clean/youtube")
    there = {path for path in (root / "clean/youtube").rglob("*") if path.is_file()}
    assert {root / "clean/youtube" / name for name in found.files} == {
        path for path in there if path.name != MANIFEST
    }
    for name, entry in found.files.items():
        path = root / "clean/youtube" / name
        assert (entry.size, entry.sha256) == (path.stat().st_size, digest(path))
        if path.suffix == ".parquet":
            assert entry.rows == pq.read_metadata(path).num_rows
            assert manifest.content_digest(path) == entry.sha256


def test_editing_notes_what_changed_and_promises_nothing_when_it_is_cut_off(root: Path) -> None:
    before = manifest.read_manifest(root, "clean/youtube")
    assert before is not None
    path = one(root / "clean/youtube/videos")
    with pytest.raises(KeyboardInterrupt), manifest.editing(root, "clean/youtube"):
        path.write_bytes(path.read_bytes() + b"x")
        raise KeyboardInterrupt
    cut = manifest.read_manifest(root, "clean/youtube")
    assert cut is not None
    assert set(cut.files) == set(before.files)
    assert not any(entry.sha256 for entry in cut.files.values())
    path.write_bytes(path.read_bytes()[:-1])
    with manifest.editing(root, "clean/youtube"):
        pass
    assert manifest.read_manifest(root, "clean/youtube") == before


def test_a_copied_root_is_current_and_a_changed_one_is_not(root: Path, tmp_path: Path) -> None:
    copy = shutil.copytree(root, tmp_path / "copy")
    for number, path in enumerate(sorted(copy.rglob("*"), reverse=True)):
        os.utime(path, (1_000_000 + number, 1_000_000 + number))
    for name in ("clean/youtube", "release/youtube"):
        assert not freshness.reasons(run_at(copy), name)
    segment = next(iter((copy / "raw/youtube/videos").iterdir()))
    segment.rename(segment.with_name(f"{segment.name}.open"))  # the same bytes
    assert not freshness.reasons(run_at(copy), "clean/youtube")
    (segment.parent / "00000099.ndjson.zst").write_bytes(b"more")
    assert freshness.reasons(run_at(copy), "clean/youtube") == ["raw/youtube"]
    videos = one(copy / "clean/youtube/videos")
    with manifest.editing(copy, "clean/youtube"):
        write_table(videos, read_table(videos).slice(1), "youtube/videos")
    assert freshness.reasons(run_at(copy), "release/youtube") == ["clean/youtube"]
