"""`kb update`: what was deleted at a service is gone here within one run; quotas are respected."""

import json
import os
from collections import Counter
from collections.abc import Iterator
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import pytest

from kb.sandbox.world import World
from kb.store.lock import writer
from tests.contract.conftest import Figureless as Job
from tests.faults import Sandbox
from tests.reddit.dumped import post, write
from tests.youtube.ytdlp.folder import write_video

LATER = "2027-01-10T12:00:00Z"


@pytest.fixture
def job(tmp_path: Path) -> Iterator[Job]:
    world = World(n_channels=6, n_videos=40, n_posts=16, width=12, depth=4)
    with Sandbox(world, services=["youtube", "reddit"]) as sandbox:
        yield Job(sandbox, tmp_path)


def asked(job: Job, before: int = 0) -> list[tuple[str, str]]:
    """The path and the query of each request since, but for those of a token."""
    every = job.sandbox.ledger.requests(since=before)
    return [(one.path, one.query) for one in every if not one.path.endswith("/access_token")]


def test_what_is_gone_there_is_gone_here_and_nothing_is_asked_twice(job: Job) -> None:
    job.done("youtube", "crawl")
    job.done("youtube", "filter")
    job.done("reddit", "crawl")
    job.done("reddit", "filter")
    (gone, *_) = job.rows("SELECT video_id FROM clean.youtube_videos ORDER BY video_id")
    job.sandbox.world.youtube.videos[gone["video_id"]].in_api = False
    (deleted, *_) = job.rows("SELECT post_id FROM clean.reddit_posts ORDER BY post_id")
    job.sandbox.world.reddit.gone.add(f"t3_{deleted['post_id']}")
    plan = job.done("update", "--plan", KB_NOW=LATER)
    assert plan["requests"] > 0
    assert {one["artifact"] for one in plan["steps"]} >= {"pairs", "release"}
    before = len(job.sandbox.ledger)
    done = job.done("update", KB_NOW=LATER)
    assert list(done["sources"]) == ["youtube", "reddit"]
    for source, table, key in (
        ("youtube", "youtube_videos", {"video_id": gone["video_id"]}),
        ("reddit", "reddit_posts", {"post_id": deleted["post_id"]}),
    ):
        assert done["sources"][source][f"purge {source}"]["also"] >= 1
        ((name, value),) = key.items()
        for schema in ("clean", "release"):
            assert job.rows(f"FROM {schema}.{table} WHERE {name} = '{value}'") == []
        for file in (job.root / "release").rglob("*.parquet"):
            assert value.encode() not in file.read_bytes()
    twice = [one for one, n in Counter(asked(job, before)).items() if n > 1]
    assert twice == []
    before = len(job.sandbox.ledger)
    again = job.done("update", KB_NOW=LATER)
    made = {one["artifact"] for one in again["steps"] if one["outcome"] == "made"}
    # Lists were read again, and of videos they give the same rows.
    assert made <= {"clean/youtube", "clean/reddit", "report", "release"}
    assert not [path for path, _ in asked(job, before) if path.endswith(("/videos", "/timedtext"))]


@pytest.mark.slow
def test_a_quota_ends_a_source_and_the_next_days_go_on(job: Job) -> None:
    """The other source and the build are done; within the days nothing is asked twice. A source
    that waits for somebody decides the exit code.
    """
    job.done("youtube", "crawl")
    job.done("reddit", "crawl")
    job.profile(("[youtube]\n", "[youtube]\nunits_per_day = 5\n"))
    before, codes = len(job.sandbox.ledger), []
    job.sandbox.faults.add("^/r/", service="reddit", status=403, body="<html>blocked</html>")
    for day in range(10, 20):
        began = len(job.sandbox.ledger)
        done = job.kb("update", "--json", KB_NOW=f"2027-01-{day}T12:00:00Z")
        codes.append(done.returncode)
        told: dict[str, Any] = json.loads(done.stdout.splitlines()[-1])
        assert sum("/youtube/v3/" in path for path, _ in asked(job, began)) <= 5 + 6  # searches
        assert "reddit crawl" in told["sources"]["reddit"]
        assert not {"failed"} & {one["outcome"] for one in told["steps"]}
        if done.returncode == 0:
            break
        assert "quota" in done.stderr
        quota = f"quota until 2027-01-{day + 1}T08:00:00Z"
        steps = told["sources"]["youtube"].values()
        assert quota in [step.get("waits_for") for step in steps]
        assert told["waits_for"] == (quota if codes[1:] else "person")
    assert codes == [4, *[3] * (len(codes) - 2), 0]
    api = [one for one in asked(job, before) if "/youtube/v3/" in one[0]]
    assert [one for one, n in Counter(api).items() if n > 1] == []


@pytest.mark.parametrize("reddit", [False, True])
def test_a_quota_that_ended_the_first_crawl_before_any_item_is_no_failure(
    job: Job, reddit: bool
) -> None:
    """Lists were read, and no video: there is nothing to make of them yet, but of the rest."""
    job.profile(("[youtube]\n", "[youtube]\nunits_per_day = 2\n"))
    job.stopped("youtube", "crawl", code=3)
    if reddit:
        job.done("reddit", "crawl")
    for day in (10, 11):
        if not job.raw("videos"):
            done = job.done("update", KB_NOW=f"2027-01-{day}T12:00:00Z", code=3)
            assert done["waits_for"] == f"quota until 2027-01-{day + 1}T08:00:00Z"
            assert done.get("made", 0) > 0 if reddit else "made" not in done
            run = job.kb("status", "--runs").stdout.splitlines()[1]
            assert "update" in run
            assert "waits for quota until" in run
            assert "{" not in run
    job.profile(("units_per_day = 2\n", ""))
    assert job.done("update", KB_NOW="2027-01-12T12:00:00Z")["made"] > 0


def test_the_second_run_names_the_first(job: Job) -> None:
    job.done("youtube", "crawl")
    before = len(job.sandbox.ledger)
    with writer(job.root, "youtube"):
        refused = job.stopped("update", code=1)
    assert str(os.getpid()) in refused
    assert len(job.sandbox.ledger) == before


def test_an_update_keeps_to_what_the_crawl_was_bounded_by(job: Job) -> None:
    """Ids and their part, without a search; the earliest date, and not the latest one."""
    ids = sorted(job.sandbox.world.youtube.videos)[:12]
    (job.place / "ids.txt").write_text("\n".join(ids))
    job.done("youtube", "crawl", "--ids", "ids.txt", "--part", "1/2")
    posts = list(job.sandbox.world.reddit.posts.values())  # oldest first
    early, middle, late = (posts[len(posts) * n // 4 : len(posts) * (n + 1) // 4] for n in range(3))
    since, until = (
        f"{datetime.fromtimestamp(some[0]['created_utc'], UTC):%Y-%m-%dT%H:%M:%SZ}"
        for some in (middle, late)
    )
    job.done("reddit", "crawl", "--since", since, "--until", until)
    before = len(job.sandbox.ledger)
    job.done("update", KB_NOW=LATER)
    paths = [path for path, _ in asked(job, before)]
    assert not any(path.endswith(("/v3/search", "/v3/playlistItems")) for path in paths)
    trees = {post["id"]: any(f"/{post['id']}" in path for path in paths) for post in posts}
    assert not any(trees[post["id"]] for post in early)
    assert all(trees[post["id"]] for post in late)
    (job.place / "ids.txt").unlink()
    assert "ids.txt of the last crawl is gone" in job.kb("update", "--plan").stderr


def test_only_what_was_crawled_takes_part(job: Job) -> None:
    assert job.kb("update").returncode == 2  # no data root
    job.done("reddit", "crawl", "--limit", "3", code=3)
    refused = job.kb("update", "youtube")
    assert refused.returncode == 1
    assert "kb youtube crawl" in refused.stderr
    assert job.kb("update", "nothing").returncode == 2
    before = len(job.sandbox.ledger)
    for lacking in ("REDDIT_CLIENT_ID", "KB_CONTACT"):
        assert job.kb("update", **{lacking: ""}).returncode == 2
    assert len(job.sandbox.ledger) == before


def test_the_plan_counts_the_round_that_it_would_start(job: Job) -> None:
    """Within 5 % of what the update then sends, where nothing is new; and by phase."""
    job.done("youtube", "crawl")
    job.done("reddit", "crawl")
    plan = job.done("update", "--plan")
    assert "nothing is new since the last round" in plan["assumed"]
    phases = {one["phase"]: one["requests"] for one in plan["phases"]}
    assert phases["youtube crawl: searches"] > 0
    assert phases["youtube crawl: channels"] > 0
    before = len(job.sandbox.ledger)
    job.done("update")
    sent = len(asked(job, before))
    assert abs(plan["requests"] - sent) <= 0.05 * sent


def test_what_was_imported_is_read_again_without_a_request(job: Job, tmp_path: Path) -> None:
    """New files in the folders and dumps that the root remembers."""
    folder, dump = tmp_path / "films", tmp_path / "dumps"
    folder.mkdir()
    dump.mkdir()
    write_video(folder, 1)
    write(dump / "RS_2024-01.zst", [post("p1")])
    job.done("youtube", "import", str(folder))
    job.done("reddit", "import", str(dump))
    write_video(folder, 2)
    write(dump / "RS_2024-02.zst", [post("p2")])
    plan = job.done("update", "--plan")
    assert plan["requests"] == 0
    assert {one["phase"]: one["items"] for one in plan["phases"]} == {
        "youtube import: folders and files": 1,
        "reddit import: folders and files": 1,
    }
    assert "reddit import: folders and files" in job.kb("update", "--plan").stdout
    done = job.done("update")
    for source in ("youtube", "reddit"):
        assert done["sources"][source][f"{source} import"]["crawled"] == 1
    assert len(job.sandbox.ledger) == 0
    folder.rename(tmp_path / "elsewhere")
    failed = job.kb("update", "--json")
    assert failed.returncode == 1
    assert "films, which was imported before, is gone" in failed.stderr
