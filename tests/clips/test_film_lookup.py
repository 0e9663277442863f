"""Which file is the film of a video: found by name, taken by its length."""

import os
import shutil
from fractions import Fraction
from pathlib import Path

import av
import numpy as np
import pytest

from kb.clips.film_lookup import candidates, film_length_s, find_films
from tests.clips.films import film

ID, OTHER = "9LTiW466lNx", "f7Ls9uxGu_x"
SMALL = ((64, 36), {"preset": "veryfast"})


def silent(path: Path, seconds: int, codec: str = "libx264", **options: object) -> Path:
    """A film of one picture a second."""
    path.parent.mkdir(parents=True, exist_ok=True)
    film(path, codec, range(seconds), Fraction(1), *SMALL, **options)
    return path


@pytest.fixture(scope="module")
def lengths(tmp_path_factory: pytest.TempPathFactory) -> dict[int, Path]:
    """Films by their lengths in s."""
    folder = tmp_path_factory.mktemp("lengths")
    return {
        seconds: silent(folder / f"{seconds}.mp4", seconds) for seconds in (20, 57, 59, 60, 300)
    }


def laid_out(folder: Path, films: dict[str, Path | bytes]) -> Path:
    for name, content in films.items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        if isinstance(content, bytes):
            path.write_bytes(content)
        else:
            shutil.copy(content, path)
    return folder


def test_every_form_of_name_is_found(tmp_path: Path) -> None:
    ids = (ID, "-_abcdefghi", OTHER, "nEiYFJtc4Jx")
    names = (
        f"{ID}.mp4",
        "deep/er/A [good] day [-_abcdefghi].WEBM",
        f"{OTHER}/video.mkv",
        f"{ID}.json",
        "nEiYFJtc4Jx.mp4.part",
        f"._{ID}.mp4",
        f"__MACOSX/{OTHER}.mp4",
    )
    laid_out(tmp_path, dict.fromkeys(names, b""))
    (tmp_path / "nEiYFJtc4Jx.mp4").symlink_to(tmp_path / "nowhere")
    found = candidates([tmp_path], ids)
    assert found == {key: [tmp_path / name] for key, name in zip(ids[:3], names, strict=False)}


def test_the_first_folder_counts(tmp_path: Path) -> None:
    for name in ("b", "a"):
        laid_out(tmp_path / name, {f"{ID}.mp4": b""})
    found = candidates([tmp_path / "b", tmp_path / "a"], [ID])
    assert found == {ID: [tmp_path / name / f"{ID}.mp4" for name in ("b", "a")]}


def test_linked_folders_are_entered_and_loops_end(tmp_path: Path) -> None:
    films = (f"{ID}.mp4", f"lost+found/{ID}.mp4", f"more/{OTHER}.mp4")
    disk = laid_out(tmp_path / "disk", dict.fromkeys(films, b""))
    (disk / "more/back").symlink_to(disk)
    (tmp_path / "films").mkdir()
    (tmp_path / "films/linked").symlink_to(disk)
    (tmp_path / "films/self").symlink_to(tmp_path / "films")
    found = candidates([tmp_path / "films", disk], [ID, OTHER])
    linked = tmp_path / "films/linked"
    assert found == {ID: [linked / f"{ID}.mp4"], OTHER: [linked / f"more/{OTHER}.mp4"]}


CHAPTER = f"A pot - 001 Clay [{ID}].mp4"


@pytest.mark.parametrize(
    ("files", "video_s", "taken"),
    [
        ({f"{ID}.mp4": 60}, 61, f"{ID}.mp4"),
        ({f"{ID}.mp4": 57}, 60, "the film lasts 57.0 s, the video 60 s"),
        ({f"{ID}.mp4": 300}, 302.9, f"{ID}.mp4"),
        ({f"{ID}.mp4": 20}, None, f"{ID}.mp4"),
        ({f"{ID}.mp4": 20}, 0, f"{ID}.mp4"),
        ({f"a/{ID}.mp4": 20, f"b/{ID}.mp4": 60}, 60, f"b/{ID}.mp4"),
        ({f"a/{ID}.mp4": b"", f"b/{ID}.mp4": b"no film", f"c/{ID}.mp4": 60}, 60, f"c/{ID}.mp4"),
        ({f"{ID}.mp4": b""}, 60, "the file is empty"),
        ({f"{ID}.mp4": b"no film"}, 60, "Invalid data"),
        ({CHAPTER: 20, f"A pot [{ID}].mp4": 60}, 60, f"A pot [{ID}].mp4"),
        ({CHAPTER: 20}, 60, "the film lasts 20.0 s, the video 60 s"),
        ({CHAPTER: 20}, None, "is the film of a chapter"),
        ({CHAPTER: 59, f"A pot - 002 End [{ID}].mp4": 20}, 60, "is the film of a chapter"),
        ({f"Fred - 001 Clay [{ID}].mp4": 60}, 60, f"Fred - 001 Clay [{ID}].mp4"),
        ({f"{ID}.f137.mp4": 20, f"{ID}.f136.mp4": 60}, 60, f"{ID}.f136.mp4"),
    ],
)
def test_the_film_that_is_as_long_as_the_video_is_taken(
    lengths: dict[int, Path],
    tmp_path: Path,
    files: dict[str, int | bytes],
    video_s: float | None,
    taken: str,
) -> None:
    contents = {
        name: lengths[content] if isinstance(content, int) else content
        for name, content in files.items()
    }
    found = find_films([laid_out(tmp_path, contents)], {ID: video_s, OTHER: 60})
    if taken.endswith(".mp4"):
        assert found == ({ID: tmp_path / taken}, {}, not video_s)
    else:
        reason = "film_differs" if "film" in taken else "undecodable"
        assert found.films == {}
        assert found.reason(ID)[0] == reason
        assert taken in found.reason(ID)[1]
    assert found.reason(OTHER) == ("missing", "no file of this video")


def test_what_is_no_regular_file_is_not_opened(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / f"{ID}.mp4")
    found = find_films([tmp_path], {ID: 60})
    assert found.reason(ID) == ("undecodable", "it is a FIFO, not a file")


@pytest.mark.parametrize("ending", ["mkv", "webm", "ts", "mpg", "avi", "mov"])
def test_a_length_is_that_of_the_packets(tmp_path: Path, ending: str) -> None:
    codec = {"webm": "libvpx-vp9", "mpg": "mpeg2video", "avi": "mpeg4"}.get(ending, "libx264")
    path = tmp_path / f"film.{ending}"
    film(path, codec, range(20 * 25), Fraction(1, 25), (64, 36))
    assert film_length_s(path) == pytest.approx(20, abs=0.2)
    # A download that broke off still promises the whole length in its header.
    if ending not in ("mov",):
        path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
        assert film_length_s(path) < 15


def test_sound_that_goes_on_behind_the_pictures_counts(tmp_path: Path) -> None:
    path = silent(tmp_path / "pictures.mp4", 5)
    with (
        av.open(str(path)) as pictures,
        av.open(str(tmp_path / "film.mkv"), "w") as out,
    ):
        shown = out.add_stream_from_template(pictures.streams.video[0])
        heard = out.add_stream("aac", rate=48_000)
        heard.layout = "mono"
        for packet in pictures.demux(video=0):
            if packet.pts is not None:
                packet.stream = shown
                out.mux(packet)
        for number in range(12 * 48_000 // 1024):
            quiet = np.zeros((1, 1024), np.float32)
            frame = av.AudioFrame.from_ndarray(quiet, format="fltp", layout="mono")
            frame.sample_rate, frame.pts = 48_000, number * 1024
            out.mux(heard.encode(frame))
        out.mux(heard.encode(None))
    assert film_length_s(tmp_path / "film.mkv") == pytest.approx(12, abs=0.2)
