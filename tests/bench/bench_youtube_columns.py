"""One million raw video records: parse + filter + export, against the same job as plain Python over
dicts.

Both read the same raw segments and must keep and reject the same records at the same stages.
Peak memory must not grow with the number of records.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

SCRIPT = Path(__file__).with_name("youtube_records.py")
ROOT = SCRIPT.parents[2]
SMALL, LARGE = 100_000, 1_000_000

pytestmark = pytest.mark.bench


def script(*arguments: object) -> dict[str, Any]:
    """One process for each measurement, so that its memory is its own."""
    done = subprocess.run(
        [sys.executable, str(SCRIPT), *map(str, arguments)],
        capture_output=True,
        text=True,
        check=False,
        env=os.environ | {"PYTHONPATH": str(ROOT)},
    )
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout) if done.stdout.strip() else {}


def test_rate_and_memory(tmp_path: Path) -> None:
    figures: dict[tuple[str, int], dict[str, Any]] = {}
    for size in (SMALL, LARGE):
        root = tmp_path / str(size)
        script("make", root, size)
        for name, what, workers in (
            ("plain", "plain", 1),
            ("one worker", "ours", 1),
            ("two workers", "ours", 2),
        ):
            figures[name, size] = script(what, root, workers)
    print(
        f"\n{'':12} {'records':>10} {'seconds':>8} {'CPU s':>7} {'records/s':>10}"
        f" {'ratio':>6} {'peak MB':>8} {'worker MB':>9}"
    )
    for (name, size), found in figures.items():
        ratio = figures["plain", size]["seconds"] / found["seconds"]
        print(
            f"{name:12} {size:10,} {found['seconds']:8.1f} {found['cpu_s']:7.1f}"
            f" {size / found['seconds']:10,.0f} {ratio:6.2f}"
            f" {found['peak_mb']:8} {found['worker_mb']:9}"
        )
    for size in (SMALL, LARGE):
        for name in ("one worker", "two workers"):
            for count in ("kept", "rejected"):
                assert figures[name, size][count] == figures["plain", size][count]
    for name in ("one worker", "two workers"):
        small, large = (
            max(figures[name, size]["peak_mb"], figures[name, size]["worker_mb"])
            for size in (SMALL, LARGE)
        )
        assert large < 1.5 * small, (
            f"{name}: {small} MB for {SMALL:,} records, {large} MB for {LARGE:,}"
        )
