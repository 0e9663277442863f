"""`kb merge`: what several machines collected is one data root."""

from __future__ import annotations

import shutil
import sqlite3
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import pyarrow.parquet as pq
import pytest

from kb.core.errors import OtherService
from kb.sandbox.world import World
from kb.store.layout import Layout
from kb.store.rawlog import rawlog
from kb.store.state import tombstones
from tests.faults import Sandbox
from tests.youtube.job import Job


@pytest.fixture(scope="module")
def sandbox() -> Iterator[Sandbox]:
    with Sandbox(World(n_channels=3, n_videos=40)) as services:
        yield services


@pytest.fixture(scope="module")
def parts(sandbox: Sandbox, tmp_path_factory: pytest.TempPathFactory) -> list[Job]:
    """Two machines that share a crawl."""
    jobs = [Job(sandbox, tmp_path_factory.mktemp(f"machine{number}")) for number in (1, 2)]
    for number, job in enumerate(jobs, 1):
        job.done("youtube", "crawl", "--part", f"{number}/2")
    return jobs


def videos(job: Job) -> dict[str, dict[str, object]]:
    job.done("youtube", "filter")
    folder = job.root / "clean/youtube"
    return {
        table: {
            row[key]: {name: value for name, value in row.items() if name != "fetched_at"}
            for path in sorted((folder / table).glob("*.parquet"))
            for row in pq.read_table(path).to_pylist()
        }
        for table, key in (("videos", "video_id"), ("rejected", "key"), ("transcripts", "video_id"))
    }


def units(root: Path) -> int:
    with closing(sqlite3.connect(Layout(root).state("youtube"))) as state:
        return int(state.execute("SELECT sum(units) FROM ledger").fetchone()[0])


def requests(root: Path) -> int:
    with closing(sqlite3.connect(Layout(root).state("youtube"))) as state:
        return int(state.execute("SELECT count(*) FROM ledger").fetchone()[0])


def test_parts_of_a_crawl_are_the_whole_one(
    sandbox: Sandbox, parts: list[Job], tmp_path: Path
) -> None:
    alone, merged = Job(sandbox, tmp_path / "alone"), Job(sandbox, tmp_path / "merged")
    alone.done("youtube", "crawl")
    roots = [str(job.root) for job in parts]
    done = merged.done("merge", *roots)
    assert done["files"] == sum(len(rawlog.all_segments(job.root, "youtube")) for job in parts)
    assert done["requests"] == sum(requests(job.root) for job in parts) == requests(merged.root)
    again = merged.done("merge", *roots)
    assert (again["files"], again["requests"]) == (0, 0)
    assert requests(merged.root) == done["requests"]

    # Channels that only the other part had found are read now, and nothing is asked for again.
    merged.done("youtube", "crawl")
    assert units(merged.root) <= units(alone.root) + len(parts)
    assert videos(merged) == videos(alone)
    asked = len(sandbox.ledger)
    assert merged.done("youtube", "crawl")["crawled"] == 0
    assert len(sandbox.ledger) == asked


@pytest.mark.parametrize(
    "words",
    [("youtube", "crawl", "--plan"), ("update", "--plan"), ("status",), ("youtube", "filter")],
    ids=" ".join,
)
def test_the_first_command_after_a_merge_takes_the_answers_into_the_state(
    parts: list[Job], tmp_path: Path, words: tuple[str, ...]
) -> None:
    merged = Job(parts[0].sandbox, tmp_path)
    merged.done("merge", *(str(job.root) for job in parts))
    line = "youtube: raw answers that its state did not have are taken in"
    assert merged.kb(*words).stderr.count(line) == 1
    assert line not in merged.kb(*words).stderr
    plan = merged.done("youtube", "crawl", "--plan")
    assert (plan["searches"], plan["assumed"]) == (0, None)
    assert plan["channels"] > 0  # those that only the other part had found


def test_parts_that_know_all_channels_spend_what_one_machine_does(tmp_path: Path) -> None:
    """Each searches for its keywords, learns what the others found, and reads its channels."""
    phases = ("uploads", "metadata")
    with Sandbox(World(n_channels=12, n_videos=300), services=["youtube"]) as sandbox:
        alone, found = Job(sandbox, tmp_path / "alone"), Job(sandbox, tmp_path / "found")
        for phase in ("channels", *phases):
            alone.done("youtube", "crawl", "--only", phase)
        machines = [Job(sandbox, tmp_path / f"part{number}") for number in (1, 2, 3)]
        for number, job in enumerate(machines, 1):
            job.done("youtube", "crawl", "--only", "channels", "--part", f"{number}/3")
        found.done("merge", *(str(job.root) for job in machines))
        for number, job in enumerate(machines, 1):
            job.done("merge", str(found.root))
            for phase in phases:
                job.done("youtube", "crawl", "--only", phase, "--part", f"{number}/3")
        merged = Job(sandbox, tmp_path / "merged")
        merged.done("merge", *(str(job.root) for job in machines))
        for job in (alone, merged):
            job.done("youtube", "crawl", "--only", "metadata")
    assert described(merged.root) == described(alone.root)
    assert len(described(merged.root)) == 300
    assert units(merged.root) <= 1.05 * units(alone.root)


def described(root: Path) -> set[str]:
    """Videos whose metadata was asked for."""
    asked = (
        one.request.params["id"].split(",") for one in rawlog.envelopes(root, "youtube", "videos")
    )
    return {key for keys in asked for key in keys}


def test_a_merge_that_was_cut_short_goes_on(parts: list[Job], tmp_path: Path) -> None:
    merged = Job(parts[0].sandbox, tmp_path)
    roots = [str(job.root) for job in parts]
    merged.done("merge", *roots)
    segments = rawlog.all_segments(merged.root, "youtube")
    whole = {path.name: path.read_bytes() for path in segments}
    segments[0].unlink()
    # An earlier copy of a segment that has grown since.
    segments[1].write_bytes(segments[1].read_bytes()[: segments[1].stat().st_size // 2])
    assert merged.done("merge", *roots)["files"] == 2
    assert {p.name: p.read_bytes() for p in rawlog.all_segments(merged.root, "youtube")} == whole


def test_what_one_machine_has_purged_stays_away(parts: list[Job], tmp_path: Path) -> None:
    purged = shutil.copytree(parts[0].root, tmp_path / "purged")
    tombstones.add_tombstones(
        purged, "youtube", [("gone0000001", "named"), ("person_channel", "named")]
    )
    merged = Job(parts[0].sandbox, tmp_path / "home")
    tombstones.add_tombstones(merged.root, "youtube", [("gone0000002", "named")])
    merged.done("merge", str(purged), str(parts[1].root))
    assert tombstones.keys(merged.root, "youtube") >= {"gone0000001", "gone0000002"}
    assert tombstones.people(merged.root, "youtube") == {"channel"}


def test_what_one_machine_has_purged_leaves_what_the_others_bring(
    parts: list[Job], tmp_path: Path
) -> None:
    first = Job(parts[0].sandbox, tmp_path / "first")
    shutil.copytree(parts[0].root, first.root)
    first.done("youtube", "filter")
    gone = next(
        row["video_id"]
        for path in (first.root / "clean/youtube/videos").glob("*.parquet")
        for row in pq.read_table(path, columns=["video_id"]).to_pylist()
    )
    (tmp_path / "ids.txt").write_text(gone + "\n")
    assert first.done("purge", "youtube", "--ids", str(tmp_path / "ids.txt"))["purged"] == 1
    assert raw_with(parts[0].root, gone)
    merged = Job(parts[0].sandbox, tmp_path / "merged")
    merged.done("merge", str(first.root), str(parts[0].root), str(parts[1].root))
    assert raw_with(merged.root, gone) == []
    assert not Layout(merged.root).purge("youtube").exists()
    tables = videos(merged)
    assert len(tables["videos"]) > 1
    assert all(gone not in rows for rows in tables.values())


def test_a_removal_by_name_on_one_machine_holds_for_what_the_others_bring(
    parts: list[Job], tmp_path: Path
) -> None:
    first = Job(parts[0].sandbox, tmp_path / "first")
    shutil.copytree(parts[0].root, first.root)
    first.done("youtube", "filter")
    channel, video = next(
        (row["channel_id"], row["video_id"])
        for path in (first.root / "clean/youtube/videos").glob("*.parquet")
        for row in pq.read_table(path, columns=["channel_id", "video_id"]).to_pylist()
    )
    (tmp_path / "channels.txt").write_text(channel + "\n")
    first.done("purge", "youtube", "--channels", str(tmp_path / "channels.txt"))
    merged = Job(parts[0].sandbox, tmp_path / "merged")
    merged.done("merge", str(first.root), str(parts[0].root), str(parts[1].root))
    for name in (channel, video):
        assert raw_with(parts[0].root, name)
        assert raw_with(merged.root, name) == []


def raw_with(root: Path, text: str) -> list[str]:
    return [
        path.name
        for path in rawlog.all_segments(root, "youtube")
        if any(text.encode() in line for _, line in rawlog.Frames(path))
    ]


def test_roots_that_do_not_belong_together_are_refused(parts: list[Job], tmp_path: Path) -> None:
    merged = Job(parts[0].sandbox, tmp_path / "home")
    first, other = (shutil.copytree(job.root, tmp_path / job.place.name) for job in parts)
    for way in ("profile", "host", "key"):
        if way == "profile":
            path = Layout(other).profile
            path.write_bytes(path.read_bytes().replace(b'"minecraft"', b'"stardew"'))
        elif way == "host":
            path = Layout(other).identity("youtube")
            path.write_bytes(path.read_bytes().replace(b"127.0.0.1", b"other.example"))
        else:
            path = Layout(other).key_mark("reddit", "b" * 32)
            Layout(first).key_mark("reddit", "a" * 32).parent.mkdir(exist_ok=True)
            Layout(first).key_mark("reddit", "a" * 32).touch()
            path.parent.mkdir(exist_ok=True)
            path.touch()
        refused = merged.kb("merge", str(first), str(other))
        assert refused.returncode == OtherService("").exit_code, refused.stderr
        assert refused.stderr.count("\n") == 1
        assert not merged.root.exists()
        shutil.rmtree(other)
        shutil.copytree(parts[1].root, other)
