"""Purge: what was named or has vanished leaves every folder, and nothing brings it back."""

import json
import shutil
import signal
from collections.abc import Iterator
from pathlib import Path

import pytest

from kb.artifacts import domain_binding
from kb.core.config.profile import load_profile
from kb.sandbox.world import World
from tests.crash import harm
from tests.faults import Sandbox
from tests.youtube.job import Job


def traces(job: Job, key: str) -> set[str]:
    """Folders of the data root where a video is still named, raw segments looked into."""
    found = set()
    for path in job.root.rglob("*"):
        if (
            path.is_file()
            and not path.name.startswith("tombstones")
            and key.encode() in path.read_bytes()
        ):
            found.add(str(path.relative_to(job.root)))
    for kind in ("playlist_items", "videos", "transcripts"):
        if any(key in str(envelope) for envelope in job.raw(kind)):
            found.add(f"raw/{kind}")
    return found


@pytest.fixture(scope="module")
def once(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Job]:
    """A job whose videos are crawled, filtered, exported in two layouts, paired."""
    with Sandbox(World(n_channels=9, n_videos=30), services=["youtube"]) as sandbox:
        job = Job(sandbox, tmp_path_factory.mktemp("once"))
        for words in (
            ("youtube", "crawl"),
            ("youtube", "filter"),
            ("youtube", "export"),
            ("youtube", "export", "--format", "minedojo"),
            ("pairs",),
            ("links",),
            ("index",),
        ):
            job.done(*words)
        yield job


@pytest.fixture
def finished(once: Job, tmp_path: Path) -> Job:
    """A copy of it on the same services; it knows where its profile is now."""
    job = Job(once.sandbox, tmp_path)
    shutil.copytree(once.root, job.root)
    domain_binding.note(job.root, load_profile(job.env["KB_PROFILE"]))
    return job


def kept(job: Job) -> list[str]:
    return [
        row["video_id"]
        for row in job.rows("SELECT video_id FROM clean.youtube_videos ORDER BY video_id")
    ]


def ids_file(job: Job, *keys: str) -> str:
    path = job.place / "gone.txt"
    path.write_text("".join(f"{key}\n" for key in keys))
    return str(path)


def test_named_videos_leave_every_folder_and_stay_away(finished: Job) -> None:
    job, before = finished, kept(finished)
    paired = {row["video_id"] for row in job.rows("SELECT DISTINCT video_id FROM clean.pairs")}
    (fallen,) = job.rows(
        "SELECT key, title FROM clean.youtube_rejected WHERE stage = 'views' LIMIT 1"
    )
    assert fallen["title"]
    named = [next(key for key in before if key in paired), before[-1], fallen["key"]]
    assert traces(job, named[0])
    vanished = {
        row["key"]
        for row in job.rows("SELECT key FROM clean.youtube_rejected WHERE stage = 'missing'")
    }
    done = job.kb("purge", "youtube", "--ids", ids_file(job, *named, "no id"), "--json")
    summary = json.loads(done.stdout.splitlines()[-1])
    made = [line for line in done.stderr.splitlines() if line.endswith(": removed by a purge")]
    assert {"clean/youtube", "pairs", "links"} <= {line.partition(":")[0] for line in made}
    assert "raw/youtube" not in done.stderr  # nor any other input that is what it was
    counted = (summary["purged"], summary["also"], summary["bad_lines"])
    assert counted == (len(named), len(vanished - {*named}), 1)
    for key in (*named, *vanished):
        assert traces(job, key) == set()
    assert kept(job) == [key for key in before if key not in named]
    left = "SELECT key, title FROM clean.youtube_rejected WHERE key = '{key}' OR title = '{title}'"
    title = fallen["title"].replace("'", "''")
    assert job.rows(left.format(key=fallen["key"], title=title)) == []
    reasons = {
        row["key"]: row["reason"] for row in job.rows("SELECT key, reason FROM youtube_tombstones")
    }
    assert reasons == dict.fromkeys(vanished, "vanished") | dict.fromkeys(named, "named")
    # Neither the channel's list nor the user's own list of ids brings them back.
    job.done("youtube", "crawl", "--again")
    job.done("youtube", "crawl", "--ids", ids_file(job, *named))
    job.done("youtube", "filter")
    for key in (*named, *vanished):
        assert traces(job, key) <= {"raw/playlist_items"}
    assert kept(job) == [key for key in before if key not in named]


def test_nothing_to_purge_changes_nothing(job: Job) -> None:
    job.done("youtube", "crawl")
    first = job.done("purge", "youtube")
    assert (first["purged"], first["also"]) == (0, len(job.rows("FROM youtube_tombstones")))
    before = job.digests("raw")
    assert job.done("purge", "youtube")["also"] == 0
    assert job.digests("raw") == before


def test_a_purge_that_was_killed_goes_on(finished: Job) -> None:
    """Killed at ever later moments until it comes through; in the end nothing is left, whatever was
    done twice.
    """
    job = finished
    named = kept(job)[:3]
    words = ("purge", "youtube", "--ids", ids_file(job, *named))
    shutil.copytree(job.root, job.place / "whole")
    length = harm.run([*words, "--data", "whole"], job.env, job.place).operations
    for fifth in range(1, 5):
        moment = max(1, length * fifth // 5)
        ended = harm.run(words, job.env, job.place, harm=harm.KILL, before=moment)
        assert ended.code in (-signal.SIGKILL, 0), ended.err
        if ended.code == 0:
            break
        words = ("purge", "youtube")  # the list of names is remembered
    assert fifth > 1, "it was not killed"
    job.done("purge", "youtube")
    # Killed before it wrote its list down, a purge has promised nothing; named again it must be
    # complete.
    job.done("purge", "youtube", "--ids", ids_file(job, *named))
    for key in named:
        assert traces(job, key) == set()
    assert not list((job.root / "state").glob("*.purge.json"))


def test_a_plan_counts_and_changes_nothing(finished: Job) -> None:
    """By table and folder, the same numbers as the purge; nothing is sent."""
    job = finished
    named = [row["video_id"] for row in job.rows("SELECT DISTINCT video_id FROM clean.pairs")][:2]
    words = ("purge", "youtube", "--ids", ids_file(job, *named))
    before, asked = job.digests(), len(job.sandbox.ledger)
    plan = job.done(*words, "--plan")
    assert job.digests() == before
    assert len(job.sandbox.ledger) == asked
    counts = {(line["folder"], line["what"]): line["count"] for line in plan["lines"]}
    assert counts["clean/youtube/videos", "youtube/videos"] == 2
    assert counts["release/youtube", "youtube/videos"] == 2
    assert counts["raw/youtube/transcripts", "answers"] == 2
    pairs = len(job.rows(f"SELECT 1 FROM clean.pairs WHERE video_id IN {tuple(named)}"))
    assert counts["pairs", "pairs/pairs"] == counts["release/pairs", "pairs/pairs"] == pairs > 0
    done = job.done(*words)
    rows = sum(plan[name] for name in ("rows", "pairs", "links"))
    assert (done["purged"], done["rows"]) == (plan["purged"], rows)
    assert job.done(*words, "--plan")["lines"] == []
