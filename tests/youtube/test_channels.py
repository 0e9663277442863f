"""A channel that asks to be left out leaves every file, and none of its videos comes in again."""

import json
import shutil
import signal
from collections.abc import Iterator
from pathlib import Path

import pytest

from kb.core.errors import SettingError
from kb.sandbox.world import World
from kb.store.layout import Layout
from kb.store.state import tombstones
from kb.youtube import purge
from kb.youtube.parse.channels import mark
from tests.crash import harm
from tests.faults import Sandbox
from tests.reddit.work import texts
from tests.youtube.job import Job
from tests.youtube.ytdlp.folder import info, video_id, write_video

ID = "UC" + "aB3-_" * 4 + "xy"


@pytest.fixture(scope="module")
def sandbox() -> Iterator[Sandbox]:
    with Sandbox(World(n_channels=6, n_videos=24), services=["youtube"]) as sandbox:
        yield sandbox


@pytest.fixture
def job(sandbox: Sandbox, tmp_path: Path) -> Job:
    return Job(sandbox, tmp_path)


def listed(job: Job, *lines: str) -> str:
    path = job.place / "request.txt"
    path.write_text("\n".join(lines) + "\n")
    return str(path)


def traces(job: Job, *needles: str) -> list[str]:
    """Files of the data root with one of these, but for tombstones."""
    return [
        f"{needle} in {path}"
        for path, found in texts(job.root).items()
        for needle in needles
        if needle in found and Path(path).stem != "tombstones"
    ]


def requests_for(job: Job, channel: str, since: int = 0) -> list[str]:
    """What was asked about a channel's list of uploads."""
    seen = job.sandbox.ledger.requests("playlistItems", since=since)
    return [one.query for one in seen if channel[2:] in one.query]


def test_a_channel_leaves_every_file_and_stays_away(job: Job) -> None:
    for words in ("youtube crawl", "youtube filter", "youtube export", "pairs", "tasks", "release"):
        job.done(*words.split())
    (row,) = job.rows(
        "SELECT channel_id, count(*) AS kept FROM clean.youtube_videos GROUP BY ALL"
        " ORDER BY kept DESC, channel_id LIMIT 1"
    )
    channel = next(one for one in job.sandbox.world.youtube.channels if one.id == row["channel_id"])
    own = sorted({one.id for one in channel.videos})
    others = {row["video_id"] for row in job.rows("SELECT video_id FROM clean.youtube_videos")}
    others -= set(own)
    assert others
    assert len(own) >= row["kept"] > 0
    file = listed(job, "@handle", f"https://m.youtube.com/channel/{channel.id}/videos?view=0")
    before = job.digests()
    plan = job.done("purge", "youtube", "--channels", file, "--plan")
    assert job.digests() == before
    said = job.kb("purge", "youtube", "--channels", file, "--json")
    summary = json.loads(said.stdout.splitlines()[-1])
    assert channel.id not in said.stdout + said.stderr
    assert "handle" not in said.stderr.split(" of a handle (@name)")[0]
    for counts in (plan, summary):
        assert (counts["known"], counts["unknown"], counts["unread"]) == (0, 0, 1)
    assert summary["purged"] == plan["purged"] >= len(own)
    digest = mark(channel.id)
    gone = (channel.id, channel.uploads, channel.title, digest, *own)
    assert not traces(job, *gone)
    kept = {row["video_id"] for row in job.rows("SELECT video_id FROM clean.youtube_videos")}
    assert kept == others
    assert tombstones.people(job.root, "youtube") == {digest}
    released = (job.root / "release/youtube/tombstones.ndjson").read_text()
    assert set(own) <= {json.loads(line)["key"] for line in released.splitlines()}
    assert digest not in released
    assert channel.id not in released

    since = len(job.sandbox.ledger)
    job.done("youtube", "crawl", "--again")
    job.done("youtube", "filter")
    assert not requests_for(job, channel.id, since)
    assert not traces(job, *gone)
    again = job.done("purge", "youtube", "--channels", file)
    assert (again["purged"], again["known"]) == (0, 1)


@pytest.mark.parametrize("way", ["discovery", "ids", "raw of another machine"])
def test_videos_that_nobody_has_seen_are_skipped(job: Job, way: str, tmp_path: Path) -> None:
    job.root.mkdir()
    channel = max(job.sandbox.world.youtube.channels, key=lambda one: len(one.videos))
    other = next(one for one in job.sandbox.world.youtube.channels if one is not channel)
    own = [one.id for one in channel.videos]
    summary = job.done("purge", "youtube", "--channels", listed(job, channel.id))
    assert (summary["purged"], summary["unknown"]) == (0, 1)
    since = len(job.sandbox.ledger)
    if way == "discovery":
        done = job.done("youtube", "crawl")
    elif way == "ids":
        (job.place / "ids").write_text("\n".join([*own, *(one.id for one in other.videos)]))
        done = job.done("youtube", "crawl", "--ids", str(job.place / "ids"))
        assert done["crawled"] == len({one.id for one in other.videos})
    else:
        far = Job(job.sandbox, tmp_path / "far")
        done = far.done("youtube", "crawl")
        shutil.copytree(far.root / "raw", job.root / "raw", dirs_exist_ok=True)
    assert done["left"] == done["failed"] == 0
    filtered = job.done("youtube", "filter")
    assert filtered["kept"] > 0
    assert filtered["failed"] == filtered["pending"] == 0
    every = (
        "SELECT video_id AS key FROM clean.youtube_videos"
        " UNION ALL SELECT key FROM clean.youtube_rejected"
    )
    there = {row["key"] for row in job.rows(every)}
    assert there
    assert not there & set(own)
    if way == "raw of another machine":
        assert traces(job, channel.id)
        assert job.done("purge", "youtube")["purged"] >= len(set(own))
    else:
        assert not requests_for(job, channel.id, since)
        assert tombstones.keys(job.root, "youtube") == set()
    assert not traces(job, channel.id, channel.title)


def test_an_import_skips_what_is_of_the_channel(job: Job) -> None:
    """Whichever of a video's files the disk lists first."""
    folder = job.place / "videos"
    theirs = write_video(folder / "a", 1, channel_id=ID)
    others = write_video(folder / "b", 2)
    entries = [info(video_id(3), channel_id=ID), info(video_id(4))]
    flat = [{"id": video_id(5), "channel_id": ID, "title": "x"}, {"id": video_id(6), "title": "y"}]
    uploads = [{"id": video_id(7), "title": "z"}]
    lists = {"PL1": entries, "PL2": flat, "UU" + ID[2:]: uploads}
    for name, listed_there in lists.items():
        record = {"_type": "playlist", "extractor_key": "YoutubeTab", "id": name, "title": name}
        (folder / f"{name}.info.json").write_text(json.dumps({**record, "entries": listed_there}))
    job.root.mkdir()
    job.done("purge", "youtube", "--channels", listed(job, ID))
    for _ in range(2):
        summary = job.done("youtube", "import", str(folder))
        assert not traces(job, theirs, video_id(3), video_id(5), video_id(7), ID, ID[2:])
    assert (summary["crawled"], summary["subtitles"]) == (0, 0), "nothing is read twice"
    assert summary["left_out_by"]["purged"] >= 2
    assert all(traces(job, key) for key in (others, video_id(4), video_id(6)))


def test_an_imported_channel_is_purged(job: Job) -> None:
    folder = job.place / "videos"
    theirs, others = write_video(folder / "a", 1, channel_id=ID), write_video(folder / "b", 2)
    entries = [{"id": video_id(5), "title": "x"}]
    record = {"_type": "playlist", "extractor_key": "YoutubeTab", "id": "UU" + ID[2:]}
    (folder / "all.info.json").write_text(json.dumps({**record, "title": "t", "entries": entries}))
    job.done("youtube", "import", str(folder))
    job.done("youtube", "filter")
    assert job.done("purge", "youtube", "--channels", listed(job, ID))["purged"] == 2
    assert not traces(job, theirs, video_id(5), ID, ID[2:])
    assert traces(job, others)


def test_a_purge_that_was_killed_goes_on_without_the_list(job: Job) -> None:
    """The id of the channel is nowhere but in what is left to purge."""
    folder = job.place / "videos"
    theirs = [write_video(folder, number, channel_id=ID) for number in (1, 2)]
    others = write_video(folder, 3)
    job.done("youtube", "import", str(folder))
    job.done("youtube", "filter")
    job.done("youtube", "export")
    words = ["purge", "youtube", "--channels", listed(job, ID)]
    shutil.copytree(job.root, job.place / "whole")
    length = harm.run([*words, "--data", "whole"], job.env, job.place).operations
    killed = 0
    for tenth in range(2, 10, 2):
        moment = max(1, length * tenth // 10)
        ended = harm.run(words, job.env, job.place, harm=harm.KILL, before=moment)
        killed += ended.code == -signal.SIGKILL
        if Layout(job.root).purge("youtube").exists():
            words = ["purge", "youtube"]
    assert killed > 1
    job.done("purge", "youtube")
    assert not traces(job, ID, mark(ID), *theirs)
    assert traces(job, others)
    assert tombstones.people(job.root, "youtube") == {mark(ID)}


def test_what_only_tables_have_is_found(job: Job) -> None:
    job.done("youtube", "import", str(folder_of_one(job)))
    job.done("youtube", "filter")
    shutil.rmtree(job.root / "raw")
    Layout(job.root).state("youtube").unlink()
    said = job.kb("purge", "youtube", "--channels", listed(job, ID), "--json")
    summary = json.loads(said.stdout.splitlines()[-1])
    assert (summary["purged"], summary["unknown"]) == (1, 0)
    assert (said.returncode, "clean/youtube failed" in said.stderr) == (1, True)  # without raw data
    assert not list(job.root.glob("clean/youtube/**/*.parquet"))


def folder_of_one(job: Job) -> Path:
    write_video(job.place / "videos", 1, channel_id=ID)
    return job.place / "videos"


@pytest.mark.parametrize(
    "entry",
    [
        ID,
        f"https://www.youtube.com/channel/{ID}",
        f"http://m.youtube.com/channel/{ID}/videos",
        f"youtube.com/channel/{ID}?sub_confirmation=1",
        f"https://YouTube.com/channel/{ID}#about",
        f"/channel/{ID}",
    ],
)
def test_every_form_of_a_channel(entry: str) -> None:
    assert purge.channel_id(entry) == ID


@pytest.mark.parametrize(
    "entry",
    [
        "@handle",
        "https://www.youtube.com/@handle",
        "https://www.youtube.com/c/name",
        "https://www.youtube.com/user/name",
        f"https://example.com/channel/{ID}",
        f"https://www.youtube.com.example.com/channel/{ID}",
        f"https://www.youtube.com/watch?v=aaaaaaaaaaa&next=/channel/{ID}",
        ID[:-1],
        f"{ID}x",
        "aaaaaaaaaaa",
    ],
)
def test_what_names_no_channel(entry: str) -> None:
    assert purge.channel_id(entry) is None


def test_a_list_of_handles_is_refused(tmp_path: Path) -> None:
    (tmp_path / "list").write_text("@handle\n")
    with pytest.raises(SettingError, match="line 1") as error:
        purge.PEOPLE.read_people(tmp_path / "list")
    assert "(@name)" in error.value.hint
    assert "@handle" not in f"{error.value}{error.value.hint}"
