"""`kb verify`, `kb refresh` and `kb purge` at the command line."""

import json
import shutil
from pathlib import Path
from typing import Any

import pytest

from tests.cli.commands.test_sources import LATER, job, planned  # noqa: F401  a fixture
from tests.verify.conftest import made, root  # noqa: F401  fixtures
from tests.verify.test_root import flipped, one
from tests.youtube.job import Job


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


@pytest.mark.parametrize("source", ["youtube", "reddit"])
def test_a_refresh_costs_what_its_plan_says(job: Job, source: str) -> None:  # noqa: F811
    job.done(source, "crawl")
    plan = planned(job, "refresh", source, KB_NOW=LATER)
    done = job.done("refresh", source, KB_NOW=LATER)
    assert plan["phases"][0]["items"] == done["crawled"] > 100
    token = 1 if source == "reddit" else 0  # a request for it
    assert plan["requests"] == done["requests"] - token
    assert plan["units"] == done.get("units", 0)
    assert planned(job, "refresh", source, KB_NOW=LATER)["requests"] == 0


@pytest.mark.parametrize(
    ("words", "idle"),
    [
        ("youtube crawl --limit 5", "--limit has"),
        ("youtube crawl --again --wait", "--wait and --again have"),
        ("youtube crawl --only uploads", "--only has"),
        ("youtube crawl --part 1/2", "--part has"),
        ("wiki crawl --limit 5", "--limit has"),
        ("reddit crawl --since 2026-01-01 --until 2026-02-01", "--since and --until have"),
        ("reddit reconstruct --out there", "--out has"),
        ("refresh youtube --limit 5", "--limit has"),
        ("refresh reddit --wait", "--wait has"),
        ("purge reddit --workers 2", "--workers has"),
    ],
)
def test_an_option_that_a_plan_leaves_out_is_refused(job: Job, words: str, idle: str) -> None:  # noqa: F811
    job.root.mkdir(exist_ok=True)
    said = job.stopped(*words.split(), "--plan", code=2)
    assert f"{idle} no effect on --plan" in said


def test_a_plan_of_a_root_that_was_moved_writes_nothing(job: Job, tmp_path: Path) -> None:  # noqa: F811
    """The remembered file of the profile is beside the root, as before, at another place."""
    job.done("reddit", "crawl")
    shutil.copytree(job.place, tmp_path / "moved")
    copy = tmp_path / "moved" / job.root.name
    profile = tmp_path / "moved" / "profile" / "profile.toml"

    def files() -> dict[str, tuple[int, bytes]]:
        # SQLite needs two files beside one that it reads, and leaves them.
        paths = [path for path in copy.rglob("*") if path.is_file() and "sqlite-" not in path.name]
        return {str(path): (path.stat().st_mtime_ns, path.read_bytes()) for path in paths}

    before = files()
    for words in ("purge reddit", "reddit crawl", "refresh reddit"):
        moved = {"KB_DATA": str(copy), "KB_PROFILE": str(profile)}
        job.done(*words.split(), "--plan", **moved)
        assert files() == before
