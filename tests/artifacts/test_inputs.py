"""What is out of date is known by content: a copy without its times is as fresh as the original."""

from __future__ import annotations

import os
import shutil
from pathlib import Path
from typing import Any

from kb.artifacts import inputs
from kb.artifacts.complete import note_export
from kb.store import parquet
from kb.store.layout import Layout
from kb.store.shards import write_table


def test_a_copied_root_is_not_stale_and_a_changed_one_is(tmp_path: Path, make_rows: Any) -> None:
    root, copy = tmp_path / "root", tmp_path / "copy"
    at = Layout(root)
    segment = at.raw("youtube", "videos") / "00000001.ndjson.zst.open"
    segment.parent.mkdir(parents=True)
    segment.write_bytes(b"one")
    rows = make_rows("youtube/videos", 3)
    write_table(at.clean("youtube", "videos") / "part-00000.parquet", rows, "youtube/videos")
    inputs.note_raw(at.clean("youtube"), inputs.of_raw(root, "youtube"))
    note_export(root, "youtube", inputs.of_clean(root, "youtube"))
    shutil.copytree(root, copy)
    for number, path in enumerate(sorted(copy.rglob("*"), reverse=True)):
        os.utime(path, (1_000_000 + number, 1_000_000 + number))
    assert inputs.is_filtered(copy, "youtube")
    assert inputs.is_exported(copy, "youtube")
    segment.rename(segment.with_suffix(""))  # closed, the same bytes
    assert inputs.is_filtered(root, "youtube")
    segment.with_suffix("").write_bytes(b"one and more")
    assert not inputs.is_filtered(root, "youtube")
    other = make_rows("youtube/videos", 4)
    write_table(at.clean("youtube", "videos") / "part-00000.parquet", other, "youtube/videos")
    assert not inputs.is_exported(root, "youtube")


def test_a_file_without_our_checksum_has_a_fingerprint_too(tmp_path: Path) -> None:
    for name, text in (("a", b"1"), ("b", b"1"), ("c", b"2")):
        (tmp_path / name).write_bytes(text)
    a, b, c = (parquet.fingerprint(tmp_path / name) for name in "abc")
    assert (a == b, a == c) == (True, False)
