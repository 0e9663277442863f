"""A folder of a data root moves to another disk, with a link in its place: nothing else changes."""

from __future__ import annotations

import json
import os
import shutil
from collections.abc import Iterator
from pathlib import Path

import pytest

from kb.sandbox.world import World
from kb.store.layout import Layout
from kb.store.rawlog import rawlog
from kb.store.rawlog.raw_files import raw_files
from tests.artifacts.rich_root import add_everything
from tests.faults import Sandbox
from tests.youtube.job import Job

FOLDERS = ("raw", "raw/youtube", "raw/youtube/videos", "raw/wiki/pages", "raw/wiki/pages/10")
MADE = (
    "annotations",
    "clean/youtube",
    "clean/youtube/videos",
    "labels",
    "state",
    "pairs",
    "release",
)
SOURCES = ("youtube", "wiki")


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Job]:
    """Videos and wiki pages, filtered, with pairs, labels and a release."""
    with Sandbox(World(n_channels=2, n_videos=20), services=["youtube"]) as sandbox:
        job = Job(sandbox, tmp_path_factory.mktemp("made"))
        job.done("youtube", "crawl")
        job.done("youtube", "filter")
        add_everything(job, 1)
        job.done("wiki", "filter")
        job.done("build", "youtube", "pairs")
        assert not {"clean/youtube", "clean/wiki"}.intersection(outdated(job))
        yield job


def outdated(job: Job) -> list[str]:
    """The artifacts that `kb status` calls out of date."""
    return [one["artifact"] for one in job.done("status")["stale"]]


def moved(made: Job, place: Path, *folders: str) -> Job:
    """The job on a copy of its root in which these folders are on another disk."""
    job = Job(made.sandbox, place)
    shutil.copytree(made.root, job.root)
    for folder in folders:
        disk = place / "disk" / folder.replace("/", "-")
        disk.parent.mkdir(exist_ok=True)
        os.rename(job.root / folder, disk)
        (job.root / folder).symlink_to(disk)
    return job


def found(job: Job) -> list[tuple[str, ...]]:
    """What `kb verify` finds."""
    told = json.loads(job.kb("verify", "--json").stdout.splitlines()[-1])["found"]
    return sorted((str(Path(one["path"]).relative_to(job.root)), one["what"]) for one in told)


@pytest.mark.parametrize("folder", [*FOLDERS, *MADE])
def test_a_linked_folder_is_part_of_the_root(made: Job, tmp_path: Path, folder: str) -> None:
    job = moved(made, tmp_path, folder)
    home = Job(made.sandbox, tmp_path / "home")
    home.done("merge", str(job.root))
    for source in SOURCES:
        files = [path.relative_to(made.root) for path in raw_files(made.root, source)]
        assert [path.relative_to(job.root) for path in raw_files(job.root, source)] == files
        brought = {path.relative_to(home.root) for path in raw_files(home.root, source)}
        assert brought == {path for path in files if "tombstones" not in path.name}
    assert not {"clean/youtube", "clean/wiki"}.intersection(outdated(job))
    assert outdated(job) == outdated(made)
    assert job.done("status")["disk_bytes"] == made.done("status")["disk_bytes"]
    assert found(job) == found(made)

    for source in SOURCES:
        job.done(source, "filter")
        job.done("purge", source, "--plan")
    assert (job.root / folder).is_symlink() or folder == "clean/youtube/videos"


def test_new_answers_in_a_linked_folder_are_filtered(made: Job, tmp_path: Path) -> None:
    job = moved(made, tmp_path, "raw/youtube/videos", "raw/wiki/pages")
    shot = job.root / "raw/wiki/pages/10/1/screenshot.png"
    os.rename(shot, tmp_path / "shot.png")
    shot.symlink_to(tmp_path / "shot.png")
    job.done("wiki", "export")
    segment = rawlog.segments(job.root, "youtube", "videos")[0]
    shutil.copyfile(segment, segment.with_name(f"000007-abcdef01{rawlog.SUFFIX}"))
    assert "clean/youtube" in outdated(job)
    shutil.rmtree(job.root / "raw/wiki/pages/10")
    assert "clean/wiki" in outdated(job)


def test_a_purge_reaches_what_links_lead_to(made: Job, tmp_path: Path) -> None:
    """Folders, single pages and single files."""
    job = moved(made, tmp_path, "raw/youtube/videos", "raw/wiki/pages/10", "clean/youtube/videos")
    disk = tmp_path / "disk"
    for kind in ("transcripts", "playlist_items"):
        for segment in rawlog.segments(job.root, "youtube", kind):
            os.rename(segment, disk / segment.name)
            segment.symlink_to(disk / segment.name)
    shot = job.root / "raw/wiki/pages/10/1/screenshot.png"
    os.rename(shot, disk / "shot.png")
    shot.symlink_to(disk / "shot.png")
    gone = job.rows("SELECT video_id FROM clean.youtube_videos ORDER BY video_id")[0]["video_id"]
    ids = tmp_path / "ids.txt"
    ids.write_text(f"{gone}\n")
    assert job.done("purge", "youtube", "--ids", str(ids))["purged"] >= 1
    for path in disk.rglob(f"[0-9]*{rawlog.SUFFIX}"):
        assert all(gone.encode() not in line for _, line in rawlog.Frames(path))
    for path in disk.rglob("*.parquet"):
        assert gone.encode() not in path.read_bytes()
    ids.write_text("10\n")
    job.done("purge", "wiki", "--ids", str(ids))
    assert list(disk.rglob("*.png")) == []
    assert not os.path.lexists(job.root / "raw/wiki/pages/10")


@pytest.mark.parametrize(
    ("link", "says"),
    [
        ("raw/youtube/videos/back", "is a link that leads back into the data root"),
        ("raw/wiki/pages/10/back", "is a link that leads back into the data root"),
        ("raw/youtube/lost", "which is not there"),
    ],
)
def test_a_link_that_leads_back_or_nowhere_ends_every_command_with_a_line(
    made: Job, tmp_path: Path, link: str, says: str
) -> None:
    job = moved(made, tmp_path)
    (job.root / link).symlink_to(tmp_path / "gone" if "lost" in link else job.root)
    source = link.split("/")[1]
    home = Job(made.sandbox, tmp_path / "home")
    for command in (
        f"{source} filter", "build", "build --plan", "status", f"purge {source}",
        *(["youtube crawl"] if "lost" in link else []),
    ):  # fmt: skip
        line = job.stopped(*command.split(), code=1)
        assert f"{job.root / link} is a link" in line, command
        assert says in line
    assert says in home.stopped("merge", str(job.root), code=1)
    assert not home.root.exists()
    (named,) = [one for one in job.done("verify", code=1)["found"] if one["path"].endswith(link)]
    assert named["state"] == "foreign"
    assert Layout(job.root).raw().is_dir()
