"""A purge of damaged raw data: what can be read is purged, what can't be read is set aside."""

import pickle

import pytest

from kb.artifacts.purge import PurgeRules
from kb.reddit.purge import RULES as REDDIT
from kb.store.rawlog import quarantine
from kb.wiki.purge import RULES as WIKI
from kb.youtube.purge import RULES as YOUTUBE
from tests.youtube.job import Job
from tests.youtube.test_damage import frames, job, overwrite, plain, segment, video_of

__all__ = ["job", "plain"]  # fixtures


def test_purge_keeps_both_sides_of_a_damaged_frame(job: Job) -> None:
    path = segment(job, "transcripts")
    before = frames(path)
    (start, end, line), (_, _, named) = before[len(before) // 2], before[3]
    overwrite(path, start + 10, b"\xff" * 12)
    gone = job.place / "gone.txt"
    gone.write_text(video_of(named) + "\n")
    said = job.stopped("purge", "youtube", "--ids", str(gone), code=1)
    assert f"{end - start:,} bytes at {start:,} can't be read" in said
    assert f"transcripts {video_of(line)}" in said
    assert not quarantine.quarantined_files(job.root, "youtube")  # any key may be in them
    left = {video_of(line) for _, _, line in frames(path)}
    vanished = {
        row["key"] for row in job.rows("SELECT key FROM youtube_tombstones WHERE reason <> 'named'")
    }
    asked = {video_of(line) for _, _, line in before}
    assert left == asked - vanished - {video_of(line), video_of(named)}
    assert not list((job.root / "state").glob("*.purge.json"))
    job.done("youtube", "crawl")
    assert video_of(line) in {str(one["response"]["video_id"]) for one in job.raw("transcripts")}
    job.done("purge", "youtube")


def test_a_purge_leaves_no_damaged_bytes_that_may_hold_its_key(job: Job) -> None:
    path = segment(job, "transcripts")
    _, end, line = frames(path)[4]
    overwrite(path, end - 6, b"\xff" * 6)  # all but the last block could still be read
    gone = job.place / "gone.txt"
    gone.write_text(video_of(line) + "\n")
    job.stopped("purge", "youtube", "--ids", str(gone), code=1)
    assert not quarantine.quarantined_files(job.root, "youtube")
    job.done("youtube", "crawl")
    assert video_of(line) not in {
        str(one["response"]["video_id"]) for one in job.raw("transcripts")
    }


@pytest.mark.parametrize("rules", [YOUTUBE, WIKI, REDDIT], ids=lambda rules: rules.source)
def test_worker_processes_are_given_the_rules_of_a_purge(rules: PurgeRules) -> None:
    """Segments of more than 64 MB are written again by several processes."""
    assert pickle.loads(pickle.dumps(rules)).source == rules.source
