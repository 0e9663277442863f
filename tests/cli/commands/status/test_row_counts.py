"""Tests of the row counts of `kb status`."""

from pathlib import Path
from typing import Any

from tests.cli.commands.status.conftest import fill


def test_damaged_rows_are_named(kb: Any, root: Path) -> None:
    fill(root)
    file = root / "clean" / "youtube" / "videos" / "part-0.parquet"
    file.write_bytes(file.read_bytes()[:100])
    answer = kb("status")
    assert answer.returncode == 1
    assert f"{file} can't be read" in answer.stderr
    assert "run `kb youtube filter` again" in answer.stderr
    assert answer.stderr.count("\n") == 1
