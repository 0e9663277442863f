"""A disk that fills up takes a part of what is written, of which nothing stays."""

import os
from pathlib import Path
from typing import IO, Any

import pytest

from kb.core.errors import DiskFull
from kb.store import atomic, damage
from kb.store.damage import note_damage, noted_damage
from kb.store.rawlog import rawlog
from kb.store.rawlog.rawlog import Envelope, Request, Segment
from kb.store.rawlog.recorder import Recorder, recover
from kb.store.state.frontier import Frontier
from tests.store.full import SmallDisk


class Takes:
    """An unbuffered file that takes `room` bytes more and none after that, as on a disk that fills
    up: a write that finds some room takes that part, and the next one fails.
    """

    def __init__(self, file: Any, room: int, *, cuts: bool = True) -> None:
        self._file, self._room, self._cuts = file, room, cuts

    def write(self, data: bytes) -> int:
        if not self._room:
            raise OSError(28, os.strerror(28))
        written: int = self._file.write(data[: self._room])
        self._room -= written
        return written

    def truncate(self, size: int) -> int:
        if not self._cuts:
            raise OSError(5, os.strerror(5))
        cut: int = self._file.truncate(size)
        return cut

    def __getattr__(self, name: str) -> Any:
        return getattr(self._file, name)


WHEN = "2026-11-20T12:00:00Z"


def line(number: int) -> bytes:
    return rawlog.encode(
        Envelope(WHEN, Request("videos", {"id": f"v{number}"}), 200, {"n": number})
    )


def frame(number: int) -> bytes:
    return rawlog.compressor().compress(line(number))


def numbers(root: Path) -> list[int]:
    return [entry.response["n"] for entry in rawlog.envelopes(root, "youtube", "videos")]


@pytest.mark.parametrize("answers", [(1,), (1, 2)])
def test_a_frame_is_whole_or_not_there(tmp_path: Path, answers: tuple[int, ...]) -> None:
    segment = Segment(rawlog.folder(tmp_path, "youtube", "videos"))
    segment.append(line(0))
    whole = segment._file
    for room in range(sum(len(frame(number)) for number in answers)):
        segment._file = Takes(whole, room)
        with pytest.raises(DiskFull):
            segment.append(*map(line, answers))
        assert numbers(tmp_path) == [0]
    segment._file = whole
    segment.append(*map(line, answers))
    segment.close()
    assert numbers(tmp_path) == [0, *answers]


def test_a_write_in_several_parts_is_whole(tmp_path: Path) -> None:
    class InParts(Takes):
        def write(self, data: bytes) -> int:
            written: int = self._file.write(data[:7])
            return written

    segment = Segment(rawlog.folder(tmp_path, "youtube", "videos"))
    segment.append(line(0))
    segment._file = InParts(segment._file, 0)
    assert segment.append(line(1))[1] == len(frame(0) + frame(1))
    segment.close()
    assert numbers(tmp_path) == [0, 1]


def test_a_first_frame_that_found_no_room_leaves_no_segment(tmp_path: Path) -> None:
    segment = Segment(rawlog.folder(tmp_path, "youtube", "videos"))
    segment._open()
    segment._file = Takes(segment._file, 3)
    with pytest.raises(DiskFull):
        segment.append(line(0))
    segment.close()
    assert rawlog.segments(tmp_path, "youtube", "videos") == []


def test_what_could_not_be_cut_away_is_cut_by_the_next_run(tmp_path: Path) -> None:
    segment = Segment(rawlog.folder(tmp_path, "youtube", "videos"))
    kept = [*range(1, len(frame(1)))]
    for room in kept:
        segment.append(line(room))
        segment._file = Takes(segment._file, room, cuts=False)
        with pytest.raises(DiskFull):
            segment.append(line(1_000))
    segment.close()
    recover(tmp_path, "youtube")
    assert numbers(tmp_path) == kept
    assert not list(rawlog.folder(tmp_path, "youtube", "videos").glob("*.open"))


def test_an_answer_that_the_state_had_no_room_for_is_replayed(tmp_path: Path) -> None:
    seen: list[int] = []
    full = True

    def apply(frontier: Frontier, kind: str, envelope: Envelope) -> None:
        number = envelope.response["n"]
        if full and number == 1:
            raise DiskFull("no room")
        frontier.set_cursor(f"n{number}", number)
        seen.append(number)

    def recorder(frontier: Frontier) -> Recorder:
        return Recorder(tmp_path, "youtube", frontier, apply)

    path = tmp_path / "state" / "youtube.sqlite"
    frontier = Frontier(path)
    with recorder(frontier) as one:
        one.record("videos", "videos", {"id": "v0"}, 200, {"n": 0})
        with pytest.raises(DiskFull):
            one.record("videos", "videos", {"id": "v1"}, 200, {"n": 1})
        # Another thread's, which was in flight.
        one.record("videos", "videos", {"id": "v2"}, 200, {"n": 2})
    frontier.close()
    assert seen == [0, 2]
    full = False
    frontier = Frontier(path)
    with recorder(frontier):
        assert seen == [0, 2, 1]
        assert [frontier.cursor(f"n{number}") for number in range(3)] == [0, 1, 2]
    frontier.close()
    assert sorted(numbers(tmp_path)) == [0, 1, 2]


def test_the_list_of_damaged_files_has_whole_lines(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    first, second = (tmp_path / "raw/wiki/images" / f"{letter * 64}.png" for letter in "ab")
    (tmp_path / "state").mkdir()
    note_damage(tmp_path, [first])
    assert noted_damage(tmp_path, tmp_path) == [first]
    append = atomic.append
    for room in range(len(str(first.relative_to(tmp_path))) + 1):

        def taking(file: IO[bytes], data: bytes, room: int = room) -> int:
            full: Any = Takes(file, room)
            return append(full, data)

        monkeypatch.setattr(damage, "append", taking)
        with pytest.raises(DiskFull):
            note_damage(tmp_path, [second])
        assert noted_damage(tmp_path, tmp_path) == [first]
    monkeypatch.setattr(damage, "append", append)
    note_damage(tmp_path, [second])
    assert noted_damage(tmp_path, tmp_path) == [first, second]


def test_a_real_full_disk_leaves_whole_frames(tmp_path: Path) -> None:
    disk = SmallDisk(tmp_path / "disk")
    disk.place.mkdir()
    with disk.mounted():
        segment = Segment(rawlog.folder(disk.place, "youtube", "videos"))
        disk.leave(40_000)
        written = 0
        with pytest.raises(DiskFull, match="MB free"):
            for written in range(100_000):
                segment.append(line(written))
        assert numbers(disk.place) == [*range(written)]
        disk.leave(40_000)
        segment.append(line(written))
        segment.close()
        assert numbers(disk.place) == [*range(written + 1)]
