"""Dumps of an import share the memory that the user gives, windows of their frames included."""

from __future__ import annotations

import json
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import pytest

from kb.reddit.connector.importer import _side_by_side
from kb.reddit.dumps.containers import memory
from kb.reddit.dumps.import_file import ImportJob
from kb.reddit.parse.anonymize import load_key
from tests.reddit.dumped import imported, post, write

GB = 10**9


def archived(path: Path, *keys: str) -> Path:
    """A dump with a window of 2^31 bytes, as the archives make them: one block as it is."""
    content = b"".join(json.dumps(post(key)).encode() + b"\n" for key in keys)
    header = b"\x28\xb5\x2f\xfd" + bytes([0, (31 - 10) << 3])
    path.write_bytes(header + ((len(content) << 3) | 1).to_bytes(3, "little") + content)
    return path


class Counted(ThreadPoolExecutor):
    """How many tasks were handed out and not taken back yet, at most."""

    most = 0

    def __init__(self) -> None:
        super().__init__(4)
        self.out: list[Any] = []

    def submit(self, *task: Any, **options: Any) -> Any:
        self.out = [future for future in self.out if not future.done()]
        future = super().submit(*task, **options)
        self.out.append(future)
        self.most = max(self.most, len(self.out))
        return future


def test_the_window_of_a_dump_counts(tmp_path: Path) -> None:
    wide, small = archived(tmp_path / "RS_a.zst", "aaa"), write(tmp_path / "b.zst", [post("bbb")])
    assert 1 << 31 <= memory(wide) < (1 << 31) + (1 << 28)
    assert memory(small) < 1 << 28
    behind = tmp_path / "c.zst"  # a frame without content comes first in some files
    behind.write_bytes(b"\x50\x2a\x4d\x18" + (5).to_bytes(4, "little") + b"-" * 5)
    with behind.open("ab") as file:
        file.write(wide.read_bytes())
    assert memory(behind) == memory(wide)


@pytest.mark.parametrize(("gb", "together"), [(3, 1), (1, 1), (5, 2)])
def test_two_wide_dumps_are_read_at_once_only_where_both_fit(
    tmp_path: Path, gb: int, together: int
) -> None:
    files = [archived(tmp_path / f"RS_{n}.zst", f"k{n}") for n in range(5)]
    jobs = [ImportJob(str(tmp_path), str(file), "minecraft", 0, 4e9, 0) for file in files]
    load_key(tmp_path)
    with Counted() as pool:
        cursors = list(_side_by_side(jobs, pool, window=4, most=gb * GB))
    assert pool.most <= together
    assert [cursor.fresh for cursor in cursors] == [1] * 5
    assert sorted(data["id"] for _, data in imported(tmp_path)) == [f"k{n}" for n in range(5)]
