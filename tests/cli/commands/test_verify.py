"""Tests of `kb verify` at the command line."""

import json
from pathlib import Path
from typing import Any

from tests.verify.conftest import made, root  # noqa: F401  fixtures
from tests.verify.test_root import flipped, one


def test_the_command_says_it_in_a_table_and_by_its_code(root: Path, kb: Any) -> None:  # noqa: F811
    whole = kb("verify", "--data", str(root))
    assert whole.returncode == 0, whole.stderr
    assert whole.stdout.splitlines()[0].split() == [
        "kind",
        "whole",
        "damaged",
        "missing",
        "foreign",
    ]
    path = one(root, "clean/youtube/videos/*.parquet")
    flipped(path)
    told = kb("verify", str(root), "--json", "--quiet")
    assert told.returncode == 1
    assert f"damaged: {path}: checksum mismatch" in told.stdout
    said = json.loads(told.stdout.splitlines()[-1])
    assert (said["files_damaged"], said["files_missing"], said["files_foreign"]) == (1, 0, 0)
    assert said["kinds"]["clean"]["damaged"]["files"] == 1
    assert [each["path"] for each in said["found"]] == [str(path)]
    assert told.stderr.count("\n") == 1
    assert "`kb verify --repair`" in told.stderr
    refused = kb("verify", str(root / "release/youtube"), "--repair")
    assert refused.returncode == 2
