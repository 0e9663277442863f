"""SHA-256 of files is compared with what a manifest or SHA256SUMS records."""

import json
import os
from pathlib import Path

import pytest

from kb.core.errors import DamagedData
from kb.store.artifact_registry import SUMS
from kb.store.tables import checksums


@pytest.mark.parametrize(
    ("manifest", "name"),
    [
        ("clean/wiki/_manifest.json", "clean/wiki/pages/part-00000.parquet"),
        ("pairs/_manifest.json", "pairs/pairs-00000-of-00001.parquet"),
        ("state/manifests/release-wiki.json", "release/wiki/pages-00000-of-00001.parquet"),
        ("release/wiki/SHA256SUMS", "release/wiki/pages-00000-of-00001.parquet"),
    ],
)
def test_a_recorded_file_is_verified_until_it_changes(
    tmp_path: Path, manifest: str, name: str
) -> None:
    path, record = tmp_path / name, tmp_path / manifest
    for one in (path, record):
        one.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(b"as written")
    if record.name == SUMS:
        record.write_text(checksums.listed([path]))
    else:
        entry = {"size": 10, "sha256": checksums.digest(path)}
        key = name.removeprefix("clean/wiki/" if "clean" in name else name[: name.rindex("/") + 1])
        record.write_text(json.dumps({"files": {key: entry}}))
    assert checksums.unverified_size([path]) == 10
    checksums.verify_recorded(path)
    assert checksums.unverified_size([path]) == 0
    path.write_bytes(b"As written")
    os.utime(path, ns=(0, 0))
    with pytest.raises(DamagedData, match="checksum mismatch"):
        checksums.verify_recorded(path)


def test_a_file_without_a_record_is_read_as_it_is(tmp_path: Path) -> None:
    path = tmp_path / "a.parquet"
    path.write_bytes(b"x")
    assert checksums.recorded(path) is None
    checksums.verify_recorded(path)
    asked: list[Path] = []
    checksums.verify_recorded(path, unrecorded=asked.append)
    checksums.verify_recorded(path, unrecorded=asked.append)
    assert asked == [path]
