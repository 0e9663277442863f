"""What runs leave for an operator: `state/runs`, `kb status --runs`, and the file of `--log`."""

import os
import signal
import threading
from collections.abc import Iterator
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import pytest

from kb.core.config.profile import load_profile
from kb.sandbox.world import World
from kb.store.state import run_records
from tests.contract.conftest import Figureless as Job
from tests.faults import Sandbox

FOLDER = Path("state", "runs")


@pytest.fixture
def job(tmp_path: Path) -> Iterator[Job]:
    world = World(n_channels=3, n_videos=12, n_posts=6)
    with Sandbox(world, services=["youtube", "reddit"]) as sandbox:
        yield Job(sandbox, tmp_path)


def runs(job: Job) -> list[dict[str, Any]]:
    """The runs that `kb status` knows, the newest first."""
    records: list[dict[str, Any]] = job.done("status", "--runs")["runs"]
    return records


def texts(job: Job) -> str:
    """All that the records say."""
    return "".join(path.read_text() for path in (job.root / FOLDER).iterdir())


def test_each_run_that_writes_leaves_a_record_and_no_other_does(job: Job) -> None:
    job.done("youtube", "crawl", "--limit", "3", code=3)
    job.done("youtube", "crawl")
    job.profile(("min_views = 100", "min_views = 101"))
    job.done("build")
    job.done("build")
    for words in (
        ("youtube", "crawl", "--plan"),
        ("status",),
        ("query", "SELECT 1"),
        ("search", "creeper"),
        ("verify",),
    ):
        assert job.kb(*words).returncode == 0
    assert job.kb("youtube", "crawl", "--limit", "0").returncode == 2
    again, built, whole, limited = runs(job)
    assert [one["command"] for one in (again, built, whole, limited)] == [
        "build",
        "build",
        "youtube crawl",
        "youtube crawl",
    ]
    assert (limited["exit_code"], limited["waits_for"]) == (3, "next run")
    assert limited["figures"]["crawled"] == 3
    assert whole["exit_code"] == 0
    assert built["settings"] == ["youtube.min_views 100 → 101"]
    assert {"clean/youtube", "pairs", "release"} <= set(built["made"]["made"])
    assert not again.get("made")
    assert all(one["start"] <= one["end"] and one["seconds"] >= 0 for one in runs(job))
    lines = job.kb("status", "--runs").stdout.splitlines()
    assert len(lines) == 1 + 4
    assert "waits for next run" in lines[-1]
    assert "youtube.min_views 100 → 101" in lines[2]


def test_records_name_nobody(job: Job, tmp_path: Path) -> None:
    """Neither ids, nor names of people, nor SQL, nor what a list names."""
    job.done("reddit", "crawl")
    job.done("reddit", "filter")
    job.done("youtube", "crawl")
    job.done("youtube", "filter")
    job.done("pairs")
    (video,) = job.rows("SELECT video_id FROM clean.youtube_videos LIMIT 1")
    (tmp_path / "ids.txt").write_text(video["video_id"])
    (tmp_path / "authors.txt").write_text("u/KilnRoad")
    job.done("pairs", "draw", "2", "--where", "keyword <> 'Secret'", "--out", str(tmp_path / "d"))
    job.done("purge", "youtube", "--ids", str(tmp_path / "ids.txt"))
    job.done("purge", "reddit", "--authors", str(tmp_path / "authors.txt"))
    text = texts(job)
    for private in (
        video["video_id"],
        "KilnRoad",
        "Secret",
        "keyword <>",
        "ids.txt",
        "authors.txt",
    ):
        assert private not in text
    assert [one["command"] for one in runs(job)][:2] == ["purge reddit", "purge youtube"]
    assert runs(job)[1]["figures"]["purged"] == 1


def test_the_last_thousand_are_kept_also_where_two_end_at_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(run_records, "MOST", 5)
    now, profile = datetime(2026, 11, 20, tzinfo=UTC), load_profile("minecraft")

    def keep(command: str) -> None:
        run_records.keep(
            tmp_path,
            profile,
            command=command,
            start=now,
            end=now,
            seconds=1.0,
            exit_code=0,
            summary={},
        )

    for number in range(7):
        keep(f"run {number}")
    assert [one.command for one in run_records.kept(tmp_path)] == [
        f"run {number}" for number in (6, 5, 4, 3, 2)
    ]
    newest = max((tmp_path / FOLDER).glob("0*.json"))
    other = newest.with_name(f"{newest.name.partition('-')[0]}-{os.getpid() + 1}.json")
    other.write_bytes(newest.read_bytes())  # of a process that ended at the same time
    keep("run 7")
    names = [one.command for one in run_records.kept(tmp_path)]
    assert names == ["run 7", "run 6", "run 6", "run 5", "run 4"]


def test_a_killed_run_leaves_none_and_is_in_nobodys_way(job: Job) -> None:
    asked = threading.Event()
    held = job.sandbox.faults.add(
        "/v3/playlistItems", service="youtube", hold=True, then=lambda _: asked.set()
    )
    killed = job.start("youtube", "crawl")
    assert asked.wait(60)
    os.kill(killed.pid, signal.SIGKILL)
    killed.wait(60)
    job.sandbox.faults.remove(held)
    assert runs(job) == []
    job.done("youtube", "crawl")
    assert [one["command"] for one in runs(job)] == ["youtube crawl"]


def test_a_record_that_cannot_be_written_changes_no_exit_code(job: Job) -> None:
    job.root.joinpath("state").mkdir(parents=True)
    (job.root / FOLDER).write_text("in the way")
    done = job.kb("youtube", "crawl")
    assert done.returncode == 0
    assert done.stderr.count("the run is not recorded") == 1


def test_merge_and_verify_live_with_records(job: Job, tmp_path: Path) -> None:
    """Each root keeps its own: those of another machine are no part of the data."""
    job.done("youtube", "crawl")
    other = Job(job.sandbox, tmp_path / "other", KB_DATA=str(tmp_path / "other" / "data"))
    other.done("youtube", "crawl", "--limit", "2", code=3)
    job.done("merge", str(other.root))
    assert [one["command"] for one in runs(job)] == ["merge", "youtube crawl"]
    assert job.kb("verify").returncode == 0


def test_a_log_has_a_line_an_event_and_no_secret_or_purged_id(job: Job, tmp_path: Path) -> None:
    log = tmp_path / "log" / "kb.log"
    key = job.env["YOUTUBE_API_KEY"]
    refused = job.stopped("youtube", "crawl", code=1, KB_LOG=str(log), YOUTUBE_API_KEY="AIza-other")
    job.done("youtube", "crawl", KB_LOG=str(log))
    job.done("youtube", "filter", "--log", str(log), "--workers", "2")
    (video,) = job.rows("SELECT video_id FROM clean.youtube_videos LIMIT 1")
    (tmp_path / "ids.txt").write_text(f"{video['video_id']}\nnever-there\n")
    job.done("purge", "youtube", "--ids", str(tmp_path / "ids.txt"), "--log", str(log))
    text = log.read_text(encoding="utf-8")
    assert refused.removeprefix("kb: ") in text
    assert key not in text
    assert "AIza-other" not in text
    assert video["video_id"] not in text
    lines = text.splitlines()
    for command in ("youtube crawl", "youtube filter", "purge youtube"):
        own = [line for line in lines if f" {command}[" in line]
        assert any("begins, version" in line for line in own)
        assert "ends with exit code 0 after" in own[-1]
    assert any("metadata: 12/12" in line for line in lines)


def test_a_log_that_cannot_be_written_is_told_once_and_changes_nothing(job: Job) -> None:
    plain = job.kb("youtube", "crawl")
    again = job.kb("youtube", "filter", "--log", "/dev/full")
    assert (plain.returncode, again.returncode) == (0, 0)
    assert again.stderr.count("/dev/full") == 1
    assert job.rows("SELECT count(*) AS n FROM clean.youtube_videos")[0]["n"] > 0
