"""`kb demo` does the whole job, whatever the caller's settings say."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

from tests.cli.conftest import clean_environment

STEPS = [
    "youtube crawl",
    "youtube filter",
    "youtube export",
    "wiki crawl",
    "wiki filter",
    "wiki export",
    "reddit crawl",
    "reddit import",
    "refresh reddit",
    "reddit filter",
    "reddit export",
    "reddit reconstruct",
    "pairs",
    "release",
    "report",
]


@pytest.mark.timeout(600)
def test_the_whole_job(tmp_path: Path) -> None:
    (tmp_path / ".env").write_text("YOUTUBE_API_KEY=a-real-key\nKB_YOUTUBE_ENDPOINT=http://192.0.2.1\nKB_WIKI_URL=http://192.0.2.1\n")
    real = {
        "REDDIT_CLIENT_SECRET": "a-real-secret",
        "KB_REDDIT_ENDPOINT": "http://192.0.2.1",
        "KB_TOXICITY_MODEL": "/nowhere",
    }
    done = subprocess.run(
        [sys.executable, "-m", "kb", "demo", "--json"],
        cwd=tmp_path,
        env=clean_environment() | real,
        capture_output=True,
        text=True,
        timeout=580,
        check=False,
        stdin=subprocess.DEVNULL,
    )
    assert done.returncode == 0, done.stderr[-3000:]
    summary = json.loads(done.stdout.splitlines()[-1])
    assert [name for name in summary if name in STEPS] == STEPS
    root = tmp_path / "data" / "demo"
    assert Path(summary["root"]) == root
    crawled = summary["youtube filter"]
    assert crawled["crawled"] == crawled["kept"] + crawled["rejected"] == 300
    assert (root / "report" / "index.html").is_file() or "left_out" in summary["report"]
    assert done.stdout.count("\nkb query ") >= 3
    assert list((root / "release" / "youtube").glob("videos-*.parquet"))
    for path in root.rglob("*"):
        assert not path.is_file() or b"a-real-" not in path.read_bytes()
