"""What was purged stays away, whatever becomes of its tombstones."""

import shutil
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from kb.core.errors import DamagedData
from kb.core.progress import Progress
from kb.store.state import tombstones
from kb.verify.root import verify


def reasons(root: Path) -> dict[str, str]:
    return {
        row["key"]: row["reason"] for row in tombstones.tombstone_rows(root, "youtube").to_pylist()
    }


@pytest.fixture
def two(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> tuple[Path, Path]:
    """Two machines that purged different keys, and one key both, the second machine earlier."""
    mine, other = tmp_path / "mine", tmp_path / "other"
    monkeypatch.setenv("KB_NOW", "2026-11-20T12:00:00Z")
    tombstones.add_tombstones(mine, "youtube", [("a", "named"), ("both", "vanished")])
    monkeypatch.setenv("KB_NOW", "2026-11-19T12:00:00Z")
    tombstones.add_tombstones(other, "youtube", [("b", "vanished"), ("both", "named")])
    return mine, other


def test_merged_roots_have_the_tombstones_of_both(two: tuple[Path, Path]) -> None:
    mine, other = two
    before = tombstones.version(mine, "youtube")
    tombstones.unite(mine, "youtube", other)
    assert tombstones.version(mine, "youtube") != before
    assert tombstones.keys(mine, "youtube") == {"a", "b", "both"}
    assert reasons(mine) == {"a": "named", "b": "vanished", "both": "named"}  # the older row of two
    file = tombstones.path(mine, "youtube")
    whole, at = file.read_bytes(), file.stat().st_mtime_ns
    tombstones.unite(mine, "youtube", other)
    assert (file.read_bytes(), file.stat().st_mtime_ns) == (whole, at)
    assert tombstones.add_tombstones(mine, "youtube", [("a", "vanished"), ("c", "named")]) == 1
    assert tombstones.lift(mine, "youtube", {"a", "b"}, ("vanished",)) == 1
    assert reasons(mine) == {"a": "named", "both": "named", "c": "named"}


def test_another_machine_s_file_in_its_place_is_an_error(two: tuple[Path, Path]) -> None:
    mine, other = two
    tombstones.add_tombstones(mine, "youtube", [("c", "named")])
    file = tombstones.path(mine, "youtube")
    shutil.copy(tombstones.path(other, "youtube"), file)
    with pytest.raises(DamagedData, match="has 2 of the 3 tombstones") as error:
        tombstones.keys(mine, "youtube")
    assert "kb merge" in error.value.hint
    file.unlink()
    with pytest.raises(DamagedData, match="is missing"):
        tombstones.keys(mine, "youtube")
    assert [(one.state, one.path) for one in verify(mine, Progress()).entries] == [
        ("missing", file)
    ]


def test_nothing_is_written_where_nothing_was_purged(tmp_path: Path) -> None:
    assert tombstones.keys(tmp_path, "youtube") == set()
    assert tombstones.tombstone_rows(tmp_path, "youtube").num_rows == 0
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("how", ["empty", "cut", "binary", "another table", "a folder"])
def test_a_damaged_file_is_no_empty_one(tmp_path: Path, how: str) -> None:
    """What was purged would come back."""
    tombstones.add_tombstones(tmp_path, "youtube", [("v1", "purged"), ("v2", "gone")])
    first = tombstones.path(tmp_path, "youtube")
    data = first.read_bytes()
    another = pa.BufferOutputStream()
    pq.write_table(pa.table({"key": [1]}), another)
    damaged = {
        "empty": b"",
        "cut": data[:-9],
        "binary": b"PAR1" * 40,
        "another table": another.getvalue().to_pybytes(),
    }

    def spoil(path: Path) -> None:
        path.unlink()
        if how == "a folder":
            path.mkdir()
        else:
            path.write_bytes(damaged[how])

    spoil(first)
    for use in (
        lambda: tombstones.keys(tmp_path, "youtube"),
        lambda: tombstones.tombstone_rows(tmp_path, "youtube"),
        lambda: tombstones.add_tombstones(tmp_path, "youtube", [("v3", "purged")]),
        lambda: tombstones.unite(tmp_path / "other", "youtube", tmp_path),
    ):
        with pytest.raises(DamagedData, match=f"{first} can't be read") as error:
            use()
        assert error.value.hint.startswith("restore it from a copy")
