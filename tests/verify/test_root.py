"""`kb verify`: every damaged, missing and foreign file is found, and what can be is mended."""

import shutil
from pathlib import Path

import pyarrow as pa
import pytest

from kb.artifacts import manifest
from kb.core.errors import FatalError, UsageError
from kb.core.progress import Progress
from kb.store.artifact_registry import MANIFEST
from kb.store.layout import Layout
from kb.store.tables import parquet
from kb.verify.findings import Findings
from kb.verify.root import verify as look_at


def verify(folder: Path) -> Findings:
    return look_at(folder, Progress())


def found(folder: Path) -> list[tuple[str, str, str]]:
    """(kind, state, path from the folder) of each finding."""
    return [
        (one.kind, one.state, str(one.path.relative_to(folder))) for one in verify(folder).entries
    ]


def one(root: Path, pattern: str) -> Path:
    return next(iter(sorted(root.glob(pattern))))


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
    mark = Layout(root).key_mark("reddit", "d" * 32)
    mark.parent.mkdir(parents=True, exist_ok=True)
    mark.touch()
    shutil.copytree(root / "clean/youtube/videos", root / "restored/youtube/videos")
    noted = pa.table({"table": ["pairs"], "key": [b"1"]})
    for path in (root / "state/releases/pairs/1.0.0.parquet", root / "restored/missing.parquet"):
        path.parent.mkdir(parents=True, exist_ok=True)
        parquet.write_file(path, noted)
    assert found(root) == []


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


def test_a_link_to_another_disk_is_read_through(root: Path, tmp_path: Path) -> None:
    shutil.move(root / "clean/youtube", tmp_path / "disk")
    (root / "clean/youtube").symlink_to(tmp_path / "disk")
    assert found(root) == []
    path = one(root, "clean/youtube/videos/*.parquet")
    flipped(path)
    assert found(root) == [("clean", "damaged", str(path.relative_to(root)))]


# -- releases ------------------------------------------------------------------------------------


def test_a_downloaded_release_is_whole(folders: Path) -> None:
    look = verify(folders)
    assert look.entries == []
    assert look.total("whole")[0] == sum(path.is_file() for path in folders.glob("*/*"))
    assert verify(folders / "reddit").entries == []


def test_a_folder_that_is_neither(tmp_path: Path) -> None:
    with pytest.raises(FatalError, match=r"no tables in .*, and it is not a release"):
        verify(tmp_path)
    with pytest.raises(UsageError, match="there is no data root"):
        verify(tmp_path / "nowhere")


def test_a_key_with_two_answers_is_told(root: Path) -> None:
    path = one(root, "clean/youtube/videos/*.parquet")
    shutil.copyfile(path, path.with_name("part-00001.parquet"))
    known = manifest.read_manifest(root, "clean/youtube")
    assert known is not None
    known.files["videos/part-00001.parquet"] = manifest.entry_of(path)
    manifest.write_manifest(root / "clean/youtube" / MANIFEST, known)
    (told,) = verify(root).entries
    assert "keys are in two of kept, rejected, failed and pending" in told.what
