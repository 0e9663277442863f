"""What a crawl begins with, and what answers mean for it."""

import json
import re
from pathlib import Path
from typing import Any
from urllib.parse import parse_qs

import pytest

from kb.sandbox.world import World
from kb.store.state.frontier import Frontier
from kb.youtube.crawl.reduce import SEARCHES, UPLOADS, VIDEOS
from tests.faults import Sandbox
from tests.youtube.crawl.test_fetch import CRAWL, check, finish
from tests.youtube.job import Job, plain_units


def test_the_phases_one_by_one_are_the_whole(job: Job) -> None:
    for phase in ("channels", "playlists", "uploads", "metadata", "transcripts"):
        before = len(job.sandbox.ledger)
        job.done(*CRAWL, "--only", phase)
        asked = {seen.path.rsplit("/", 1)[-1] for seen in job.sandbox.ledger.requests(since=before)}
        assert (
            asked
            == {
                "channels": {"search"},
                "playlists": {"search", "playlistItems"},
                "uploads": {"playlistItems"},
                "metadata": {"videos"},
                "transcripts": {"watch", "player", "timedtext"},
            }[phase]
        )
    check(job)
    assert job.sandbox.ledger.units() == plain_units(job.sandbox)


@pytest.mark.parametrize(
    "words",
    [
        ("--part", "3/2"),
        ("--only", "nothing"),
        ("--ids", "/no/such/file"),
        ("--ids", "/dev/null"),
        ("--ids", __file__, "--only", "channels"),
    ],
)
def test_wrong_usage_sends_and_writes_nothing(job: Job, words: tuple[str, ...]) -> None:
    job.stopped(*CRAWL, *words, code=2)
    assert len(job.sandbox.ledger) == 0
    assert not job.root.exists()


def test_a_list_that_goes_round_ends_with_a_warning(job: Job) -> None:
    channel = job.sandbox.world.youtube.channels[0]
    keys = [video.id for video in channel.entries]

    def page(environ: dict[str, Any]) -> bytes:
        token = parse_qs(environ["QUERY_STRING"]).get("pageToken", [""])[0]
        items = [{"contentDetails": {"videoId": key}} for key in keys]
        return json.dumps(
            {"items": items, "nextPageToken": {"": "A", "A": "B", "B": "A"}[token]}
        ).encode()

    job.sandbox.faults.add(f"/playlistItems.*UU{channel.id[2:]}", times=None, status=200, body=page)
    result = job.kb(*CRAWL)
    assert result.returncode == 0, result.stderr
    assert "loops" in result.stderr
    assert (
        len(
            [
                seen
                for seen in job.sandbox.ledger.requests("/playlistItems")
                if channel.id[2:] in seen.query
            ]
        )
        < 8
    )
    check(job)


def test_no_shorts_costs_one_unit_more_for_a_list_that_is_not_there(tmp_path: Path) -> None:
    with Sandbox(World(n_channels=9, n_videos=60), services=["youtube"]) as sandbox:
        job = Job(sandbox, tmp_path)
        job.profile(("min_views = 100\n", 'min_views = 100\nuploads = "no_shorts"\n'))
        job.done(*CRAWL, "--only", "channels")
        job.done(*CRAWL, "--only", "uploads")
        job.done(*CRAWL, "--only", "metadata")
        asked = {
            key
            for seen in sandbox.ledger.requests("/v3/videos")
            for key in seen.args["id"].split(",")
        }
        world = sandbox.world.youtube
        fallback = world.channels[5]
        assert asked == {
            video.id
            for video in world.videos.values()
            if not video.short or video.channel is fallback
        }
        missing = [seen for seen in sandbox.ledger.requests("/playlistItems") if seen.status == 404]
        assert (
            len(missing) == 3
        )  # two UULF lists and, of the channel without uploads list, its UU list


def test_a_new_round_reads_only_what_is_new(job: Job) -> None:
    job.done(*CRAWL)
    world = job.sandbox.world.youtube
    channel = world.channels[0]
    moved = world.channels[1].entries[-1]
    channel.entries.insert(0, moved)  # a new upload, as far as this list is concerned
    before = len(job.sandbox.ledger)
    job.done(*CRAWL, "--again")
    asked = job.sandbox.ledger.requests(since=before)
    assert not [seen for seen in asked if seen.path in ("/watch",) and seen.about != moved.id]
    lists = [seen for seen in asked if "UU" in seen.args.get("playlistId", "")[:2]]
    assert len(lists) == len(world.channels)
    check(job)


def test_a_keyword_without_a_channel_is_named_and_all_without_one_end_the_crawl(
    few: Sandbox, tmp_path: Path
) -> None:
    """It said "crawled 0" with exit 0, then "run crawl first" and "nothing left" by turns: a
    circle.
    """
    job = Job(few, tmp_path)
    path = job.profile()
    text = path.read_text()
    words = re.search(r"^keywords = \[.*?\]", text, re.MULTILINE | re.DOTALL)
    assert words
    text = re.sub(r"playlist_keywords = .*\n", "", text)
    path.write_text(text.replace(words[0], 'keywords = ["xyzzy", "plugh"]'))
    line = path.read_text().splitlines().index('keywords = ["xyzzy", "plugh"]') + 1
    for _ in range(2):  # and asked nothing twice
        said = job.stopped(*CRAWL, code=1)
        assert "finds a channel: 'xyzzy', 'plugh'" in said
        assert f"change `keywords` under [youtube] in {path}, line {line}" in said
    assert len(few.ledger) == 2
    path.write_text(text.replace(words[0], 'keywords = ["xyzzy", "minecraft"]'))
    answer = job.kb(*CRAWL, "--only", "channels", "--quiet")
    assert answer.returncode == 0
    warned = [line for line in answer.stderr.splitlines() if line.startswith("warning: ")]
    assert len(warned) == 1
    assert "'xyzzy'" in warned[0]
    assert "finds no channel" in warned[0]


def test_what_an_earlier_version_dropped_is_asked_for(job: Job) -> None:
    job.stopped(*CRAWL, "--only", "channels", "--limit", "1", code=3)
    frontier = Frontier(job.root / "state" / "youtube.sqlite")
    frontier.add_keys(VIDEOS, list(job.sandbox.world.youtube.videos)[:1])
    lost = {
        kind: [next(iter(frontier.items(kind, "todo")))[0]] for kind in (SEARCHES, UPLOADS, VIDEOS)
    }
    for kind, keys in lost.items():
        frontier.mark(kind, keys, "skipped", "http_408")
    frontier.close()
    finish(job)
    frontier = Frontier(job.root / "state" / "youtube.sqlite", readonly=True)
    assert {kind: frontier.get(kind, key)[0] for kind, (key,) in lost.items()} == dict.fromkeys(
        lost, "done"
    )
    frontier.close()
