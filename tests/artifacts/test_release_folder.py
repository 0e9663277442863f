"""Tests of `kb.artifacts.release_folder`."""

from pathlib import Path

from kb.artifacts import release_folder


def test_checksums_are_read_and_invalid_lines_are_counted(tmp_path: Path) -> None:
    assert release_folder.sums(tmp_path) == ({}, 0)
    digest = "0" * 64
    (tmp_path / "SHA256SUMS").write_text(f"{digest}  videos.parquet\nnot a checksum\n")
    assert release_folder.sums(tmp_path) == ({"videos.parquet": digest}, 1)
    (tmp_path / "SHA256SUMS").write_bytes(b"\xff\xfe")
    assert release_folder.sums(tmp_path) == ({}, 1)
