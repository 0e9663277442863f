"""Tests of what `kb status` reports of each source."""

from pathlib import Path
from typing import Any

from kb.core.summary import Summary, phrases
from kb.sandbox.world import World
from kb.store.lock import writer
from kb.store.state.frontier import Frontier
from tests.cli.commands.status.conftest import fill, status
from tests.faults import Sandbox
from tests.small_worlds import ITEMS
from tests.youtube.job import Job
from tests.youtube.ytdlp.folder import write_video


def small_world() -> World:
    """A world with every source, crawled in seconds."""
    return World(n_channels=9, n_videos=60, n_posts=24, width=120, depth=24)


def test_progress_quota_age_and_disk(kb: Any, root: Path) -> None:
    fill(root)
    about = status(kb)
    source = about["sources"]["youtube"]
    assert source["phases"]["metadata"] == {
        "done": 1,
        "error": 1,
        "in_progress": 1,
        "todo": 1,
        "total": 4,
        "left": 2,
    }
    assert source["phases"]["transcripts"]["left"] == 1
    assert source["failures"] == {"http 500": 1}
    assert "  failed: http 500 (1)\n" in kb("status").stdout
    assert (source["left"], about["left"]) == (3, 3), "what failed is counted by itself"
    assert (source["requests"], source["units"]) == (3, 3)
    assert source["quota"]["general"] == {
        "spent": 2,
        "left": 9998,
        "limit": 10000,
        "resets_at": "2026-11-21T08:00:00Z",
    }
    assert source["quota"]["search"]["spent"] == 0
    assert source["rows"] == {"videos": 2}
    assert (source["oldest"], source["newest"]) == ("2026-10-01T00:00:00Z", "2026-11-20T00:00:00Z")
    assert (source["too_old"], source["max_age_days"]) == (1, 30)
    assert about["disk_bytes"]["clean"] > 0
    assert about["disk_bytes_total"] == sum(about["disk_bytes"].values())


def test_beside_a_running_crawl(kb: Any, root: Path) -> None:
    """The crawl holds the lock and an open transaction; status neither waits nor disturbs."""
    import os

    fill(root)
    with writer(root, "youtube"):
        frontier = Frontier(root / "state" / "youtube.sqlite")
        with frontier.transaction():
            frontier.add_keys("metadata", ["e"])
            source = status(kb)["sources"]["youtube"]
            assert source["running_pid"] == os.getpid()
            assert source["phases"]["metadata"]["total"] == 4
        frontier.close()
    assert status(kb)["sources"]["youtube"]["running_pid"] is None


def test_any_name_of_the_data_root(kb: Any, tmp_path: Path) -> None:
    """What is a pattern, a query or an escape elsewhere is a letter of a folder's name here."""
    root = tmp_path / "a#b?c%41[d]*'e{f,g}"
    fill(root)
    source = status(kb, "--data", str(root))["sources"]["youtube"]
    assert source["phases"]["metadata"]["total"] == 4
    assert (source["rows"], source["too_old"]) == ({"videos": 2}, 1)
    assert list(tmp_path.iterdir()) == [root]


def test_a_stopped_crawl_says_what_is_left_as_status_does(tmp_path: Path) -> None:
    with Sandbox(small_world()) as sandbox:
        job = Job(sandbox, tmp_path)
        for source, limit in (("youtube", "50"), ("reddit", "7")):
            stopped: dict[str, Any] = job.done(source, "crawl", "--limit", limit, code=3)
            about = job.done("status")["sources"][source]
            assert stopped["crawled"] == about["crawled_so_far"] == int(limit)
            assert stopped["left_by"] == about["left_by"] != {}
            assert stopped["left"] == about["left"] == sum(about["left_by"].values())
            assert stopped["pending"] == about["left_by"][ITEMS[source]]
            left = f"left: {phrases.nouns(stopped['left_by'])}"
            assert left in Summary(stopped).line()
            text = job.kb("status").stdout
            assert left in text
            assert f"{limit} {ITEMS[source]} crawled but not filtered yet" in text
            assert f"next: kb {source} crawl\n" in text
            elsewhere = job.kb("status", "--data", str(job.root)).stdout
            assert f"next: kb {source} crawl --data {job.root}\n" in elsewhere
            rest = job.done(source, "crawl")
            assert rest["crawled_in_all"] == rest["crawled"] + int(limit)
            assert f"{rest['crawled_in_all']:,} in all" in Summary(rest).line()


def test_damaged_rows_are_named(kb: Any, root: Path) -> None:
    fill(root)
    file = root / "clean" / "youtube" / "videos" / "part-0.parquet"
    file.write_bytes(file.read_bytes()[:100])
    answer = kb("status")
    assert answer.returncode == 1
    assert f"{file} can't be read" in answer.stderr
    assert "run `kb youtube filter` again" in answer.stderr
    assert answer.stderr.count("\n") == 1


def test_what_was_imported_waits_for_a_build_and_then_for_subtitles(tmp_path: Path) -> None:
    write_video(tmp_path / "films", 1)
    write_video(tmp_path / "films", 2, forms=())
    with Sandbox(small_world()) as sandbox:
        job = Job(sandbox, tmp_path, YOUTUBE_API_KEY="")
        job.done("youtube", "import", str(tmp_path / "films"))
        assert job.kb("status").stdout.splitlines()[-1] == "next: kb build"
        planned = job.done("build", "--plan")["steps"]
        assert job.done("status")["stale"] == planned != []
        job.done("build")
        text = job.kb("status").stdout
    assert "1 pending (transcript): run `kb youtube crawl` or import transcripts" in text
    assert '`transcripts = "optional"` in [youtube] of the profile' in text
    assert text.splitlines()[-1] == "left: 1 pending"


def test_each_source_with_raw_data_is_shown(kb: Any, root: Path) -> None:
    for source, kind in {"youtube": "metadata", "wiki": "pages", "reddit": "dumps"}.items():
        segment = root / "raw" / source / kind / "00000.ndjson.zst"
        segment.parent.mkdir(parents=True)
        segment.write_bytes(b"")
        assert source in status(kb)["sources"]
        assert f"{source}\n  raw data that no table is made of yet" in kb("status").stdout
