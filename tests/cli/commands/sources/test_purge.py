"""Tests of `kb purge`."""

import shutil
from pathlib import Path

from tests.youtube.job import Job


def test_a_plan_of_a_root_that_was_moved_writes_nothing(job: Job, tmp_path: Path) -> None:
    """The remembered file of the profile is beside the root, as before, at another place."""
    job.done("reddit", "crawl")
    shutil.copytree(job.place, tmp_path / "moved")
    root = tmp_path / "moved" / job.root.name
    profile = tmp_path / "moved" / "profile" / "profile.toml"

    def files() -> dict[str, tuple[int, bytes]]:
        # SQLite needs two files beside one that it reads, and leaves them.
        paths = [path for path in root.rglob("*") if path.is_file() and "sqlite-" not in path.name]
        return {str(path): (path.stat().st_mtime_ns, path.read_bytes()) for path in paths}

    before = files()
    for words in ("purge reddit", "reddit crawl", "refresh reddit"):
        moved = {"KB_DATA": str(root), "KB_PROFILE": str(profile)}
        job.done(*words.split(), "--plan", **moved)
        assert files() == before
