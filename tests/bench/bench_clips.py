"""Clips: CPU time beside a bare PyAV loop over the same groups of pictures, mkv beside mp4, frames
a second of a DataLoader, and memory of its worker processes at 1080p.

    make bench ARGS="-k clips"
"""

import itertools
import time
from pathlib import Path

import av
import numpy as np
import psutil
import pyarrow as pa
import pytest
from PIL import Image
from torch.utils.data import DataLoader

from kb.clips.clip_files import CutOptions
from kb.clips.clip_sources import Films, cut, frame_times
from kb.clips.torch_dataset import torch_dataset

pytestmark = pytest.mark.bench

SECONDS, RATE, GROUP = 120, 30, 150  # a group of pictures of five seconds, as YouTube has them
LENGTH = 8  # s; of a clip, as MineCLIP takes them
STARTS = range(3, SECONDS - LENGTH, 17)  # gaps shorter and longer than a group
FRAMES = 16
MEMORY = 600  # MiB


@pytest.fixture(scope="module")
def films(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A picture with much detail that moves: 720p in mp4 and mkv, 1080p in mp4."""
    folder = tmp_path_factory.mktemp("films")
    for name, height, seconds in (("hd.mp4", 720, SECONDS), ("fullhd.mp4", 1080, SECONDS // 2)):
        write_moving_film(folder / name, height, seconds)
    with av.open(str(folder / "hd.mp4")) as given, av.open(str(folder / "hd.mkv"), "w") as out:
        stream = out.add_stream_from_template(given.streams.video[0])
        for packet in given.demux(video=0):
            if packet.dts is not None:
                packet.stream = stream
                out.mux(packet)
    return folder


def write_moving_film(path: Path, height: int, seconds: int) -> None:
    width = height * 16 // 9
    noise = np.random.default_rng(0).integers(0, 255, (height // 6, width // 6, 3), np.uint8)
    large = np.asarray(Image.fromarray(noise).resize((width + 256, height + 256)))
    with av.open(str(path), "w") as out:
        stream = out.add_stream("libx264", rate=RATE)
        stream.width, stream.height, stream.pix_fmt = width, height, "yuv420p"
        stream.codec_context.gop_size = GROUP
        stream.options = {"preset": "superfast", "refs": "4", "bf": "3", "sc_threshold": "0"}
        for number in range(seconds * RATE):
            x, y = number % 256, number // 2 % 256
            part = np.ascontiguousarray(large[y : y + height, x : x + width])
            frame = av.VideoFrame.from_ndarray(part, format="rgb24")
            frame.pts = number
            out.mux(stream.encode(frame))
        out.mux(stream.encode(None))


def _times() -> list[np.ndarray]:
    return [frame_times(start, start + LENGTH, FRAMES) for start in STARTS]


def _cpu_of_cutting(path: Path) -> float:
    start = time.process_time()
    clips = sum(1 for _ in cut(path, _times(), (160, 256), "stretch"))
    assert clips == len(STARTS)
    return time.process_time() - start


def _cpu_of_a_bare_loop(path: Path) -> float:
    """Decode every group that has a wanted frame, and nothing else."""
    start = time.process_time()
    with av.open(str(path)) as film:
        stream = film.streams.video[0]
        stream.codec_context.thread_count = 1
        assert stream.time_base is not None
        ticks = itertools.chain.from_iterable(one.tolist() for one in _times())
        groups = sorted({int(second * RATE) // GROUP for second in ticks})
        for group in groups:
            film.seek(int(group * GROUP / RATE / stream.time_base), stream=stream)
            for count, _ in enumerate(film.decode(stream), 1):
                if count == GROUP:
                    break
    return time.process_time() - start


def test_cutting_costs_little_more_than_decoding(films: Path) -> None:
    ours, bare, mkv = (
        min(run(films / name) for _ in range(3))
        for run, name in (
            (_cpu_of_cutting, "hd.mp4"),
            (_cpu_of_a_bare_loop, "hd.mp4"),
            (_cpu_of_cutting, "hd.mkv"),
        )
    )
    print(f"\n720p: {ours:.2f} CPU s, {ours / bare:.2f} x a bare loop; mkv {mkv / ours:.2f} x mp4")
    assert ours < 1.25 * bare
    assert mkv < 1.5 * ours


@pytest.mark.parametrize("workers", [1, 2])
@pytest.mark.parametrize("name", ["hd", "fullhd"])
def test_a_loader(films: Path, name: str, workers: int) -> None:
    starts = [start for start in STARTS if start < SECONDS // 2 - LENGTH] * 8
    rows = pa.table(
        {
            "pair_id": [f"{number:016x}" for number in range(len(starts))],
            "video_id": [name] * len(starts),
            "keyword": ["creeper"] * len(starts),
            "text": ["a creeper behind the house"] * len(starts),
            "clip_start_s": [float(start) for start in starts],
            "clip_end_s": [float(start + LENGTH) for start in starts],
        }
    )
    source = Films([films], {name: None}, CutOptions(FRAMES))
    dataset = torch_dataset(rows, source, seed=0, rank=0, world_size=1)
    peak = frames = 0
    start = time.monotonic()
    for batch in DataLoader(dataset, batch_size=4, num_workers=workers):
        frames += batch["video"].shape[0] * FRAMES
        processes = psutil.Process().children(recursive=True)
        peak = max([peak, *(one.memory_info().rss >> 20 for one in processes)])
    rate = frames / (time.monotonic() - start)
    print(f"\n{name}, {workers} workers: {rate:.0f} frames/s, {peak} MiB a worker")
    assert frames == len(starts) * FRAMES
    assert peak < MEMORY
