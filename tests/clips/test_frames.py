"""The frame shown at a time, in films whose frames carry their number."""

import random
import struct
from collections.abc import Callable
from fractions import Fraction
from pathlib import Path

import av
import numpy as np
import pytest

from kb.clips.clip_sources import cut
from kb.clips.film_lookup import candidates
from kb.clips.frames import UndecodableVideo, frames_at
from tests.clips.films import Film, bars, film, number_of


def turned(path: Path, degrees: int) -> None:
    """Write a display matrix into an mp4 that turns its picture clockwise by 90 or 180 degrees."""
    data = bytearray(path.read_bytes())
    at = data.index(b"tkhd") + 4
    matrix = at + (40 if data[at] == 0 else 52)
    one, none, w = 1 << 16, 0, 1 << 30
    values = {90: (none, one, none, -one, none), 180: (-one, none, none, none, -one)}[degrees]
    a, b, u, c, d = values
    data[matrix : matrix + 36] = struct.pack(">9i", a, b, u, c, d, 0, 0, 0, w)
    path.write_bytes(bytes(data))


OPTIONS = {
    "libx264": {"preset": "veryfast", "bf": "3"},
    "libvpx-vp9": {"deadline": "realtime", "cpu-used": "8"},
    "libsvtav1": {"preset": "8", "crf": "5", "svtav1-params": "lp=1"},  # more may deadlock
}
NTSC = Fraction(30000, 1001)
FILMS = [  # each container with an even rate, of which one has no exact decimals, and with none
    ("libx264", "mp4", Fraction(25)),
    ("libx264", "mp4", None),
    ("libx264", "mkv", NTSC),
    ("libx264", "mkv", None),
    ("libvpx-vp9", "webm", NTSC),
    ("libvpx-vp9", "webm", None),
    ("libsvtav1", "mp4", NTSC),
]
FRAMES, ASKED = 120, 300  # of each film


def _ticks(rate: Fraction | None) -> tuple[list[int], Fraction]:
    """When frames are shown; without a rate they last from 17 ms to half a second."""
    if rate is not None:
        return list(range(FRAMES)), 1 / rate
    rng, ticks = random.Random(0), [0]
    while len(ticks) < FRAMES:
        ticks.append(ticks[-1] + rng.choice([17, 33, 41, 100, 500]))
    return ticks, Fraction(1, 1000)


def _asked(made: Film, margin_s: float) -> list[float]:
    """Times anywhere in a film, at least as far from where a frame begins; without a margin also
    the very beginnings.
    """
    rng, found = random.Random(1), [float(one) for one in made.times] if not margin_s else []
    begins = np.array([float(one) for one in made.times])
    end = float(made.times[-1])  # how long the last frame lasts is up to the container
    while len(found) < ASKED:
        time = rng.uniform(0, end)
        if np.abs(np.append(begins, end) - time).min() > max(margin_s, 1e-6):
            found.append(time)
    return sorted(found)


def _shown(made: Film, time: float) -> int:
    return max(0, sum(one <= Fraction(time) + Fraction(1, 10**9) for one in made.times) - 1)


@pytest.mark.parametrize(("codec", "ending", "rate"), FILMS)
def test_every_time_has_the_frame_shown_then(
    tmp_path: Path, codec: str, ending: str, rate: Fraction | None
) -> None:
    ticks, base = _ticks(rate)
    made = film(tmp_path / f"v.{ending}", codec, ticks, base, (320, 180), OPTIONS[codec])
    # Matroska has whole milliseconds, so a frame may begin half a one earlier or later.
    times = _asked(made, 0.001 if ending != "mp4" else 0.0)
    asked = [time + 1e-9 for time in times]  # a float may be a little earlier than its fraction
    got = [number_of(image) for image in frames_at(made.path, asked, (90, 160))]
    assert got == [_shown(made, time) for time in times]


@pytest.fixture
def plain(tmp_path: Path) -> Callable[..., Film]:
    def made(name: str = "v.mp4", **changes: object) -> Film:
        size = changes.pop("size", (320, 180))
        ticks = changes.pop("ticks", range(FRAMES))
        options = OPTIONS["libx264"]
        return film(
            tmp_path / name, "libx264", ticks, Fraction(1, 25), size, options, **changes
        )  # fmt: skip

    return made


@pytest.mark.parametrize("size", [(640, 360), (1280, 720), (427, 240)])
def test_sizes(plain: Callable[..., Film], size: tuple[int, int]) -> None:
    made = plain(size=size, ticks=range(60), pixels="yuv444p" if size[0] % 2 else "yuv420p")
    got = list(frames_at(made.path, [n / 25 + 0.02 for n in range(60)]))
    assert {image.shape for image in got} == {(160, 256, 3)}
    assert [number_of(image) for image in got] == list(range(60))


def test_ten_bits(plain: Callable[..., Film]) -> None:
    made = plain(pixels="yuv420p10le", ticks=range(60))
    got = list(frames_at(made.path, [n / 25 + 0.02 for n in range(60)]))
    assert [number_of(image) for image in got] == list(range(60))
    assert got[0].dtype == np.uint8


@pytest.mark.parametrize("name", ["v.mkv", "v.ts", "v.mp4", "v.mpg"])
def test_times_are_those_of_the_film_whenever_its_clock_begins(tmp_path: Path, name: str) -> None:
    """MPEG's containers begin at 0.5 or 1.4 s of their own clock."""
    codec = "mpeg2video" if name == "v.mpg" else "libx264"
    options = {"movflags": "frag_keyframe+empty_moov"} if name == "v.mp4" else None
    made = film(tmp_path / name, codec, range(20, 80), Fraction(1, 25), format_options=options)
    got = list(frames_at(made.path, [0.0, 0.5, 0.81, 0.85, 2.39, 3.0]))
    assert [number_of(image) for image in got] == [0, 12, 20, 21, 59]


def _film_after_sound(path: Path, begins_s: int) -> None:
    """A film of 5 pictures a second, whose sound begins at 0 s and whose picture later; 40 s."""
    with av.open(str(path), "w") as out:
        video = out.add_stream("libx264", rate=Fraction(5))
        video.width, video.height, video.pix_fmt = 160, 96, "yuv420p"
        video.codec_context.time_base = Fraction(1, 5)
        sound = out.add_stream("aac", rate=8000, layout="mono")
        packets: list[av.Packet] = []
        for number in range(40 * 8):
            silence = np.zeros((1, 1000), np.float32)
            samples = av.AudioFrame.from_ndarray(silence, format="fltp", layout="mono")
            samples.sample_rate, samples.pts = 8000, 1000 * number
            samples.time_base = Fraction(1, 8000)
            packets += sound.encode(samples)
        packets += sound.encode(None)
        for number in range((40 - begins_s) * 5):
            frame = av.VideoFrame.from_ndarray(bars(number, 160, 96), format="rgb24")
            frame.pts, frame.time_base = begins_s * 5 + number, Fraction(1, 5)
            packets += video.encode(frame)
        packets += video.encode(None)
        for packet in sorted(packets, key=lambda packet: packet.dts * packet.time_base):
            out.mux(packet)


@pytest.mark.parametrize("name", ["v.mkv", "v.mp4"])
@pytest.mark.parametrize("begins_s", [3, 20])
def test_a_clip_before_the_first_picture_is_left_out(
    tmp_path: Path, name: str, begins_s: int
) -> None:
    path = tmp_path / name
    _film_after_sound(path, begins_s)
    starts = (0, begins_s - 2, begins_s, begins_s + 5)
    times = [np.array([start + 0.1, start + 3.1]) for start in starts]
    clips = {
        clip: [number_of(image) for image in images]
        for clip, images in cut(path, times, (96, 160), "stretch")
    }
    assert clips == {2: [0, 15], 3: [25, 40]}


def test_an_edit_list_that_cuts_the_beginning(plain: Callable[..., Film]) -> None:
    made = plain()
    data = bytearray(made.path.read_bytes())
    at = data.index(b"elst") + 12  # length of the segment, then its media time
    with av.open(str(made.path)) as opened:
        stretch = int(1 / opened.streams.video[0].time_base) // 25
    media = int.from_bytes(data[at + 4 : at + 8], "big") + 30 * stretch
    data[at + 4 : at + 8] = media.to_bytes(4, "big")
    made.path.write_bytes(bytes(data))
    got = list(frames_at(made.path, [n / 25 + 0.02 for n in range(80)]))
    assert [number_of(image) for image in got] == list(range(30, 110))


@pytest.mark.parametrize("name", ["v.mp4", "v.ts"])
def test_far_times_are_reached_by_a_seek(plain: Callable[..., Film], name: str) -> None:
    made = plain(name, ticks=range(2500), size=(160, 90))
    times = [0.5, 30.02, 30.5, 62.0, 99.9, 99.98]
    got = [number_of(image) for image in frames_at(made.path, times)]
    assert got == [int(time * 25) for time in times]


@pytest.mark.parametrize(("degrees", "size"), [(90, (180, 320)), (180, (320, 180))])
def test_a_turned_film_is_upright(
    plain: Callable[..., Film], degrees: int, size: tuple[int, int]
) -> None:
    """The bars of a picture turned clockwise by 90 degrees lie from top to bottom."""
    made = plain(ticks=range(60))
    turned(made.path, degrees)
    times = [n / 25 + 0.02 for n in range(60)]
    got = list(frames_at(made.path, times, size[::-1]))
    back = [np.rot90(image, degrees // 90) for image in got]
    assert [number_of(image) for image in back] == list(range(60))


def _gradients(path: Path) -> None:
    """Red grows from left to right, green from top to bottom."""
    image = np.zeros((180, 320, 3), np.uint8)
    image[..., 0] = np.linspace(0, 255, 320)[None, :]
    image[..., 1] = np.linspace(0, 255, 180)[:, None]
    with av.open(str(path), "w") as out:
        stream = out.add_stream("libx264", rate=25, options={"crf": "10"})
        stream.width, stream.height, stream.pix_fmt = 320, 180, "yuv444p"
        for _ in range(10):
            out.mux(stream.encode(av.VideoFrame.from_ndarray(image, format="rgb24")))
        out.mux(stream.encode(None))


@pytest.mark.parametrize("fit", ["stretch", "crop", "pad"])
def test_height_and_width_are_not_swapped(tmp_path: Path, fit: str) -> None:
    _gradients(tmp_path / "v.mp4")
    (image,) = frames_at(tmp_path / "v.mp4", [0.1], (160, 256), fit)
    assert image.shape == (160, 256, 3)
    inside = image[image.any(axis=(1, 2))] if fit == "pad" else image
    red, green = inside[..., 0].astype(int), inside[..., 1].astype(int)
    assert (np.diff(red.mean(axis=0)) > -1).all()
    assert (np.diff(green.mean(axis=1)) > -1).all()
    assert red[:, -8:].mean() - red[:, :8].mean() > 200
    assert green[-8:].mean() - green[:8].mean() > 200
    assert len(inside) == (144 if fit == "pad" else 160)
    cut = red[:, 0].mean() > 5
    assert cut == (fit == "crop")


def test_times_after_the_end_have_no_frame(plain: Callable[..., Film]) -> None:
    made = plain(ticks=range(50))
    assert len(list(frames_at(made.path, [0.0, 1.99, 2.01, 9.0]))) == 2


@pytest.mark.parametrize("content", [b"", b"no film" * 100, None])
def test_a_file_that_is_no_film_is_one_error(tmp_path: Path, content: bytes | None) -> None:
    path = tmp_path / "v.mp4"
    if content is None:
        with av.open(str(path), "w") as out:
            stream = out.add_stream("aac", rate=44100)
            sound = np.zeros((1, 1024), np.float32)
            frame = av.AudioFrame.from_ndarray(sound, "fltp", "mono")
            frame.rate = 44100
            out.mux([*stream.encode(frame), *stream.encode(None)])
    else:
        path.write_bytes(content)
    with pytest.raises(UndecodableVideo, match="no video stream" if content is None else None):
        list(frames_at(path, [0.0]))


def test_films_are_found_by_the_names_that_programs_give(tmp_path: Path) -> None:
    names = {
        "aaaaaaaaaaa": ["aaaaaaaaaaa.f140.webm", "aaaaaaaaaaa.f137.mp4"],
        "bbbbbbbbbbb": ["A pot-bbbbbbbbbbb.mkv"],
        "ccccccccccc": ["Clay [youtube-ccccccccccc].mp4", "Clay [ccccccccccc].f248.webm"],
        "ddddddddddd": ["ddddddddddd/video.ts"],
    }
    for files in names.values():
        for size, name in enumerate(files):
            (tmp_path / name).parent.mkdir(exist_ok=True)
            (tmp_path / name).write_bytes(b"x" * (size + 1))
    (tmp_path / "Another-eeeeeeeeeee.mp4").write_bytes(b"x")
    found = candidates([tmp_path], names)
    assert {key: files[0].relative_to(tmp_path).as_posix() for key, files in found.items()} == {
        "aaaaaaaaaaa": "aaaaaaaaaaa.f137.mp4",
        "bbbbbbbbbbb": "A pot-bbbbbbbbbbb.mkv",
        "ccccccccccc": "Clay [youtube-ccccccccccc].mp4",
        "ddddddddddd": "ddddddddddd/video.ts",
    }
