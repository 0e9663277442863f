"""The other ways through a crawl: a phase alone, parts of the ids, known ids, no Shorts, a new
round, a plan.
"""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any
from urllib.parse import parse_qs

import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from kb.core.errors import SettingError
from kb.sandbox.server import Sandbox, Server
from kb.sandbox.world import World
from kb.sandbox.youtube import service
from kb.youtube.connector.ids import read_ids
from tests.youtube.job import Job, plain_units
from tests.youtube.test_faults import CRAWL, check


def test_the_phases_one_by_one_are_the_whole(job: Job) -> None:
    for phase in ("channels", "uploads", "metadata", "transcripts"):
        before = len(job.sandbox.ledger)
        job.done(*CRAWL, "--only", phase)
        asked = {seen.path.rsplit("/", 1)[-1] for seen in job.sandbox.ledger.requests(since=before)}
        assert (
            asked
            == {
                "channels": {"search"},
                "uploads": {"playlistItems"},
                "metadata": {"videos"},
                "transcripts": {"watch", "player", "timedtext"},
            }[phase]
        )
    check(job)
    assert job.sandbox.ledger.units() == plain_units(job.sandbox)


def test_a_plan_sends_nothing_and_is_what_the_crawl_costs(job: Job) -> None:
    job.done(*CRAWL, "--only", "channels")
    job.done(*CRAWL, "--only", "uploads")
    before = len(job.sandbox.ledger)
    plan = job.done(*CRAWL, "--plan")
    assert len(job.sandbox.ledger) == before
    used = job.sandbox.ledger.units()
    job.done(*CRAWL)
    assert plan["units"] == job.sandbox.ledger.units() - used


def test_two_parts_copied_together_are_the_whole(job: Job, few: Sandbox, tmp_path: Path) -> None:
    import shutil

    roots = []
    for part in ("1/2", "2/2"):
        one = Job(few, tmp_path / part[0])
        one.done(*CRAWL, "--part", part)
        roots.append(one.root)
    for number, root in enumerate(roots):
        for path in (root / "raw").rglob("*.zst*"):
            target = job.root / "raw" / path.relative_to(root / "raw")
            target.parent.mkdir(parents=True, exist_ok=True)
            shutil.copy(path, target.with_name(f"{number}-{path.name}"))
    check(job)
    watched = [seen.about for seen in few.ledger.requests("/watch")]
    assert len(watched) == len(set(watched))  # no video was in both parts


def test_one_part_after_the_other_in_one_root_is_the_whole(job: Job) -> None:
    job.done(*CRAWL, "--part", "1/2")
    listed = len(job.sandbox.ledger.requests("/playlistItems"))
    job.done(*CRAWL, "--part", "2/2")
    assert 0 < listed < len(job.sandbox.ledger.requests("/playlistItems"))
    check(job)


def test_the_site_below_a_path(tmp_path: Path) -> None:
    """Game labels and sizes come from pages whose address begins with the root's own path."""
    sandbox = Sandbox(World(n_channels=9, n_videos=30), services=["youtube"])
    inner = service.app(sandbox.world, sandbox.faults)

    def below(environ: dict[str, Any], start: Any) -> Any:
        path = environ["PATH_INFO"]
        return inner(
            environ
            | {
                "PATH_INFO": path.removeprefix("/mirror/yt")
                if path.startswith("/mirror/yt/")
                else "/nowhere"
            },
            start,
        )

    sandbox.servers["youtube"] = Server(below)
    with sandbox:
        root = f"{sandbox.servers['youtube'].url}/mirror/yt"
        job = Job(sandbox, tmp_path, KB_YOUTUBE_ENDPOINT=root, KB_YOUTUBE_WEB=root)
        job.done(*CRAWL)
        check(job)
        found = [one["response"]["player"] for one in job.raw("transcripts")]
        assert any(one["game_label_id"] for one in found)
        assert any(one["fps"] for one in found)


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
    assert "goes round" in result.stderr
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


def test_known_ids_alone_leave_no_search_behind(job: Job) -> None:
    file = job.place / "ids.txt"
    file.write_text("\ufeff" + "\n".join(job.sandbox.world.youtube.videos), encoding="utf-8")
    assert job.done(*CRAWL, "--ids", str(file))["bad_lines"] == 0
    assert job.done("status")["left"] == 0
    check(job)
    assert "--again" in job.kb(*CRAWL, "--ids", str(file)).stderr
    assert "--again" not in job.kb(*CRAWL, "--ids", str(file), "--again").stderr


def test_ids_of_a_release_s_folder(tmp_path: Path) -> None:
    folder = tmp_path / "release"
    folder.mkdir()
    with pytest.raises(SettingError, match="contains no released videos or pairs"):
        read_ids(folder)
    for number, key in enumerate(("aaaaaaaaaaa", "bbbbbbbbbbb")):
        rows = pa.table({"video_id": [key], "title": ["t"]})
        pq.write_table(rows, folder / f"videos-0000{number}-of-00002.parquet")
    pq.write_table(pa.table({"video_id": ["ccccccccccc"]}), folder / "sample-videos.parquet")
    assert read_ids(folder) == (["aaaaaaaaaaa", "bbbbbbbbbbb"], 0)


def test_known_ids_skip_discovery(job: Job) -> None:
    ids = [video.id for video in job.sandbox.world.youtube.videos.values()]
    file = job.place / "ids.txt"
    file.write_text("\n".join([*ids[:20], "not an id", *ids[20:], ids[0]]) + "\n")
    summary = job.done(*CRAWL, "--ids", str(file))
    assert (summary["crawled"], summary["bad_lines"]) == (len(ids), 1)
    assert not job.sandbox.ledger.requests("/search|/playlistItems")
    assert job.sandbox.ledger.units() == 1
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
    assert len([seen for seen in asked if seen.path.endswith("/playlistItems")]) == len(
        world.channels
    )
    check(job)


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
