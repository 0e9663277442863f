"""One pass over a film: shots, motion and vectors; of damaged films what can be decoded."""

import random
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest

from tests.conftest import needs

needs("av", "cv2", "scenedetect")

import av  # noqa: E402

from kb.clips.frames import UndecodableVideo  # noqa: E402
from kb.score.figures import figures_of  # noqa: E402
from kb.score.film_pass import watch_film  # noqa: E402
from kb.score.film_store import SeenFilm  # noqa: E402
from kb.score.shots import Shot  # noqa: E402
from tests.score.planted import Planted, hits, write_planted  # noqa: E402


@pytest.mark.parametrize(
    ("codec", "name", "rate"),
    [("libx264", "a.mp4", 30), ("libvpx-vp9", "a.webm", 30), ("libsvtav1", "a.mkv", 60)],
)
def test_shots_begin_at_cuts_and_fades_alone(
    tmp_path: Path, codec: str, name: str, rate: int
) -> None:
    """Not at flashes, menus, pause screens and fast turns."""
    planted = Planted(5, rate, 2)
    write_planted(tmp_path / name, planted, rate, codec)
    seen = watch_film(tmp_path / name, [], None)
    assert seen.shots[0].kind == "start"
    assert [shot.start_s for shot in seen.shots[1:]] == [shot.end_s for shot in seen.shots[:-1]]
    assert seen.shots[-1].end_s == pytest.approx(planted.now_s, abs=0.1)
    for kind, within_s in (("cut", 0.1), ("fade", 0.35)):
        there = [event.at_s for event in planted.events if event.kind == kind]
        found = [shot.start_s for shot in seen.shots if shot.kind == kind]
        assert hits(there, found, within_s) == (2, 2, 2), (kind, there, found)


def a_film(path: Path, seconds: int = 4, size: tuple[int, int] = (160, 96)) -> Path:
    """Noise that changes each second."""
    rng, rate = np.random.default_rng(0), 25
    width, height = size
    with av.open(str(path), "w") as out:
        stream = out.add_stream("mpeg2video", rate=rate)
        stream.width, stream.height, stream.pix_fmt = width, height, "yuv420p"
        stream.codec_context.gop_size = 5
        for tick in range(seconds * rate):
            if tick % rate == 0:
                noise = rng.integers(0, 255, (height // 8, width // 8, 3), np.uint8)
            image = np.kron(noise, np.ones((8, 8, 1), np.uint8))
            out.mux(stream.encode(av.VideoFrame.from_ndarray(image, format="rgb24")))
        out.mux(stream.encode(None))
    return path


def test_a_damaged_or_short_film_counts_as_far_as_it_can_be_decoded(tmp_path: Path) -> None:
    whole = watch_film(a_film(tmp_path / "a.ts"), [], None)
    data = bytearray((tmp_path / "a.ts").read_bytes())
    (tmp_path / "ends.ts").write_bytes(data[: len(data) // 2])
    ends = watch_film(tmp_path / "ends.ts", [], None)
    assert 0.2 * whole.end_s < ends.end_s < 0.8 * whole.end_s
    middle = len(data) // 2
    data[middle : middle + 2000] = random.Random(0).randbytes(2000)
    (tmp_path / "damaged.ts").write_bytes(data)
    damaged = watch_film(tmp_path / "damaged.ts", [], None)
    assert damaged.end_s == pytest.approx(whole.end_s, abs=0.1)
    for content in (b"", b"no film", bytes(data[:100])):
        (tmp_path / "b.ts").write_bytes(content)
        with pytest.raises(UndecodableVideo):
            watch_film(tmp_path / "b.ts", [], None)


def test_the_first_stream_that_is_no_cover_counts_and_sizes_may_change(tmp_path: Path) -> None:
    first, second = a_film(tmp_path / "a.ts"), a_film(tmp_path / "b.ts", 4, (320, 192))
    (tmp_path / "two.ts").write_bytes(first.read_bytes() + second.read_bytes())
    seen = watch_film(tmp_path / "two.ts", [], None)
    assert seen.end_s >= watch_film(first, [], None).end_s
    with av.open(str(tmp_path / "ten.mkv"), "w") as out:
        streams = [out.add_stream("mpeg4", rate=Fraction(25)) for _ in range(10)]
        for stream in streams:
            stream.width, stream.height, stream.pix_fmt = 64, 48, "yuv420p"
        for _ in range(50):
            for place, stream in enumerate(streams):
                image = np.full((48, 64, 3), 20 * place, np.uint8)
                out.mux(stream.encode(av.VideoFrame.from_ndarray(image, format="rgb24")))
        for stream in streams:
            out.mux(stream.encode(None))
    seen = watch_film(tmp_path / "ten.mkv", [], None)
    assert seen.end_s == pytest.approx(2, abs=0.1)
    assert seen.light.max() < 10  # the first stream is black


def test_motion_stillness_and_darkness_are_those_of_the_clip() -> None:
    """A film of ten seconds: three that move by 20, three still ones, and four dark ones."""
    motion = np.array([20, 20, 20, 0, 0, 0, 0, 0, 0, np.nan], np.float32)
    light = np.array([90] * 6 + [3] * 4, np.float32)
    shots = [Shot(0, 2.5, "start"), Shot(2.5, 6, "cut"), Shot(6, 10, "fade")]
    seen = SeenFilm("", 10.0, shots, motion, light)
    clip = {"clip_start_s": 0.0, "clip_end_s": 8.0, "match_start_s": 3.0, "match_end_s": 4.0}
    found = figures_of(clip, seen)
    assert found[:3] == (2, 2.5, 6)
    assert found.motion == pytest.approx(60 / 7, abs=1e-3)
    assert found.static_share == pytest.approx(4 / 7, abs=1e-3)
    assert found.dark_share == 0.25
    within = figures_of(clip | {"clip_start_s": 6.2, "clip_end_s": 6.9}, seen)
    assert (within.cuts, within.motion) == (0, None)


class CountingModel:
    """Stands for a model: a vector of a picture is its mean colour and how many came before."""

    step_s, size, fit, device = 0.04, (16, 16), "stretch", "elsewhere"

    def __init__(self) -> None:
        self.seen = 0

    def frames(self, images: list[np.ndarray]) -> np.ndarray:
        """float32 [frames, 4]."""
        numbers = np.arange(self.seen, self.seen + len(images))
        self.seen += len(images)
        return np.column_stack([np.stack(images).mean(axis=(1, 2)), numbers]).astype(np.float32)


def test_decoding_ahead_of_a_model_gives_the_same_vectors(tmp_path: Path) -> None:
    film, ticks = a_film(tmp_path / "a.ts", seconds=4), range(90)  # three batches
    in_turn, ahead = (
        watch_film(film, ticks, CountingModel(), ahead=ahead)  # type: ignore[arg-type]
        for ahead in (False, True)
    )
    assert ahead.ticks.tolist() == in_turn.ticks.tolist() == [*ticks]
    assert ahead.vectors.tobytes() == in_turn.vectors.tobytes()
    assert 0 < ahead.model_s < ahead.pass_s


def test_a_model_that_fails_while_frames_are_decoded_ends_the_pass(tmp_path: Path) -> None:
    class Broken(CountingModel):
        def frames(self, images: list[np.ndarray]) -> np.ndarray:
            raise RuntimeError("no memory left on the device")

    with pytest.raises(RuntimeError, match="on the device"):
        watch_film(a_film(tmp_path / "a.ts"), [1], Broken(), ahead=True)  # type: ignore[arg-type]
