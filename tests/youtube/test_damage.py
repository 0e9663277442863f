"""Damaged raw data: what can be read stays, what is lost is named, set aside and asked for
again.
"""

import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from kb.sandbox.world import World
from kb.store.rawlog import quarantine, rawlog
from tests.faults import Sandbox
from tests.youtube.job import Job


@pytest.fixture(scope="module")
def plain(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Job]:
    """A job that nothing happened to: crawled, filtered, exported."""
    with Sandbox(World(n_channels=6, n_videos=40), services=["youtube"]) as sandbox:
        job = Job(sandbox, tmp_path_factory.mktemp("plain"))
        for step in ("crawl", "filter", "export"):
            job.done("youtube", step)
        yield job


@pytest.fixture
def job(plain: Job, tmp_path: Path) -> Job:
    """A copy of it on the same services."""
    copy = Job(plain.sandbox, tmp_path)
    shutil.copytree(plain.root, copy.root)
    return copy


def segment(job: Job, kind: str) -> Path:
    [path] = rawlog.segments(job.root, "youtube", kind)
    return path


def frames(path: Path) -> list[tuple[int, int, bytes]]:
    """(start, end, line) of every frame of a segment that is whole."""
    read = rawlog.Frames(path)
    return [(read.start, end, line) for end, line in read]


def overwrite(path: Path, start: int, data: bytes) -> None:
    with path.open("r+b") as file:
        file.seek(start)
        file.write(data)


def video_of(line: bytes) -> str:
    return str(rawlog.decode(line).response["video_id"])


def opened(path: Path) -> None:
    path.rename(path.with_name(path.name + ".open"))


@pytest.mark.parametrize("kind_of_file", ["closed", "open"])
def test_crawl_keeps_both_sides_of_a_damaged_frame_and_asks_again_for_it(
    plain: Job, job: Job, kind_of_file: str
) -> None:
    path = segment(job, "transcripts")
    before = frames(path)
    start, end, line = before[len(before) // 2]
    overwrite(path, start + 10, b"\xff" * 12)
    damaged = path.read_bytes()[start:end]
    if kind_of_file == "open":
        opened(path)
    else:  # the filter reads every byte, and leaves the tables as they are
        tables = job.digests("clean")
        said = job.stopped("youtube", "filter", "--quiet", code=1)
        assert f"{path.name} is damaged at byte {start:,}" in said
        assert "kb youtube crawl" in said
        assert job.digests("clean") == tables
    asked = len(job.sandbox.ledger.requests("/watch"))
    said = job.stopped("youtube", "crawl", "--quiet", code=1)
    aside = path.with_name(f"{path.name}.damaged-{start}")
    assert f"{end - start:,} bytes at {start:,}" in said
    assert aside.name in said
    assert f"transcripts {video_of(line)}" in said
    assert "kb youtube crawl" in said
    assert aside.read_bytes() == damaged
    assert [line for _, _, line in frames(path)] == [line for at, _, line in before if at != start]
    # Until it was asked for again, nobody takes it for a video without a transcript.
    assert "transcripts" in job.stopped("youtube", "filter", code=1)
    assert job.done("youtube", "crawl")["left"] == 0
    assert len(job.sandbox.ledger.requests("/watch")) == asked + 1
    for step in ("filter", "export"):
        job.done("youtube", step)
    assert job.released() == plain.released()


@pytest.mark.parametrize(
    ("kind", "how"),
    [("videos", "deleted"), ("transcripts", "cut"), ("search", "emptied"), ("videos", "cut")],
)
def test_what_a_deleted_or_cut_segment_held_is_asked_for_again(
    plain: Job, job: Job, kind: str, how: str
) -> None:
    path = segment(job, kind)
    if how == "deleted":
        path.unlink()
    else:
        with path.open("r+b") as file:
            file.truncate(path.stat().st_size // 2 if how == "cut" else 0)
    assert path.name in job.stopped("youtube", "filter", "--quiet", code=1)
    assert path.name in job.stopped("youtube", "crawl", "--quiet", code=1)
    job.done("youtube", "crawl")
    for step in ("filter", "export"):
        job.done("youtube", step)
    assert job.released() == plain.released()
    assert "nothing left" in job.kb("youtube", "crawl").stderr


def test_only_a_torn_tail_that_the_state_does_not_know_is_cut(plain: Job, job: Job) -> None:
    path = segment(job, "transcripts")
    whole = path.read_bytes()
    path.write_bytes(whole + whole[:50])
    opened(path)
    assert job.done("youtube", "crawl")["left"] == 0
    assert segment(job, "transcripts").read_bytes() == whole
    assert not quarantine.quarantined_files(job.root, "youtube")


@pytest.mark.parametrize("words", ["refresh youtube --older-than 0", "purge youtube --plan"])
def test_whoever_reads_raw_data_names_what_is_damaged(job: Job, words: str) -> None:
    """What was not read is neither fresh nor still there."""
    path = segment(job, "videos")
    start, _, _ = frames(path)[0]
    overwrite(path, start + 10, b"\xff" * 12)
    asked = len(job.sandbox.ledger)
    said = job.stopped(*words.split(), code=1)
    assert f"{path.name} is damaged at byte {start:,}" in said
    assert len(job.sandbox.ledger) == asked
    if words.startswith("refresh"):
        said = job.stopped(*words.split(), code=1)  # as the hint said
        assert f"set aside as {path.name}.damaged-{start}" in said
    else:
        assert path.name in job.stopped("youtube", "filter", code=1)
    if words.startswith("purge"):
        assert "set aside" in job.stopped("youtube", "crawl", code=1)
    job.done("youtube", "crawl")
    job.done(*words.split())


def test_a_flipped_bit_never_makes_another_answer(job: Job) -> None:
    """The frame's checksum tells it, wherever it is."""
    path = segment(job, "videos")
    whole, lines = path.read_bytes(), {line for _, _, line in frames(path)}
    for place in range(0, len(whole), max(1, len(whole) // 400)):
        flipped = bytearray(whole)
        flipped[place] ^= 1 << place % 8
        path.write_bytes(flipped)
        read = rawlog.Frames(path, skip_damage=True)
        found = {line for _, line in read}
        assert found <= lines
        assert found == lines or read.damaged or read.torn


def test_the_last_answer_of_an_open_segment_is_no_torn_tail_where_the_state_knows_it(
    job: Job,
) -> None:
    path = segment(job, "videos")
    start, end, _ = frames(path)[-1]
    overwrite(path, end - 6, b"\xff" * 6)
    opened(path)
    said = job.stopped("youtube", "filter", code=1)
    assert f"{path.name} is damaged: {end - start:,} bytes at {start:,} can't be read" in said
    assert "set aside" in job.stopped("youtube", "crawl", code=1)
    job.done("youtube", "crawl")
    job.done("youtube", "filter")


def test_a_missing_state_is_replayed_with_what_a_list_named(plain: Job, tmp_path: Path) -> None:
    job, ids = Job(plain.sandbox, tmp_path), tmp_path / "ids.txt"
    named = list(plain.sandbox.world.youtube.videos)[:30]
    ids.write_text("".join(f"{key}\n" for key in named))
    words = ("youtube", "crawl", "--only", "metadata")
    job.done(*words, "--ids", str(ids), "--limit", "20", code=3)
    for path in (job.root / "state").glob("youtube.sqlite*"):
        path.unlink()
    asked = len(job.sandbox.ledger)
    done = job.kb(*words)
    assert done.returncode == 0, done.stderr
    assert "youtube: its state is missing; it is replayed from raw data" in done.stderr
    assert len(job.sandbox.ledger) == asked + 1
    job.done("purge", "youtube", "--ids", str(ids))
    for path in rawlog.all_segments(job.root, "youtube"):
        lines = [line for _, line in rawlog.Frames(path)]
        assert not [key for key in named if any(key.encode() in line for line in lines)]


@pytest.mark.parametrize(
    "words", [("status",), ("youtube", "crawl", "--plan"), ("youtube", "filter")], ids=" ".join
)
def test_the_first_command_that_needs_a_missing_state_replays_it(
    job: Job, words: tuple[str, ...]
) -> None:
    def phases() -> dict[str, Any]:
        shown = job.done("status")["sources"]["youtube"]["phases"]
        return {name: shown[name] for name in ("videos", "transcripts")}

    before, asked = phases(), len(job.sandbox.ledger)
    for path in (job.root / "state").glob("youtube.sqlite*"):
        path.unlink()
    line = "youtube: its state is missing; it is replayed from raw data"
    assert job.kb(*words).stderr.count(line) == 1
    assert phases() == before
    assert line not in job.kb(*words).stderr
    assert len(job.sandbox.ledger) == asked
