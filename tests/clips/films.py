"""Films whose frames carry their number as sixteen bars, black for 0 and white for 1."""

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from fractions import Fraction
from functools import wraps
from pathlib import Path
from typing import NamedTuple, ParamSpec, TypeVar

import av
import numpy as np

BARS = 16
P, T = ParamSpec("P"), TypeVar("T")


class Film(NamedTuple):
    """A film, and when each frame is shown (s, exact)."""

    path: Path
    times: list[Fraction]
    last_s: Fraction  # how long the last frame is shown


def in_own_thread(write: Callable[P, T]) -> Callable[P, T]:
    """The function, run in a thread that ends with it.

    As root, SVT-AV1 gives the thread that opens it a real-time priority, which every process that
    this thread starts later inherits: two of Chromium's then kept both cores for minutes.
    """

    @wraps(write)
    def run(*args: P.args, **options: P.kwargs) -> T:
        with ThreadPoolExecutor(1) as thread:
            return thread.submit(write, *args, **options).result()

    return run


def bars(number: int, width: int, height: int) -> np.ndarray:
    """A frame with its number."""
    bits = [255 * (number >> bit & 1) for bit in range(BARS)]
    row = np.array([bits[x * BARS // width] for x in range(width)], np.uint8)
    return np.repeat(np.repeat(row[None, :, None], height, 0), 3, 2)


def number_of(image: np.ndarray) -> int:
    """The number that a frame shows, in any size."""
    width = image.shape[1]
    row = image[image.shape[0] // 2].mean(axis=-1)
    middles = [int((bar + 0.5) * width / BARS) for bar in range(BARS)]
    return sum(int(row[x] > 127) << bit for bit, x in enumerate(middles))


@in_own_thread
def film(
    path: Path,
    codec: str,
    ticks: Sequence[int],
    base: Fraction,
    size: tuple[int, int] = (640, 360),
    options: dict[str, str] | None = None,
    gop: int = 48,
    pixels: str = "yuv420p",
    numbers: Sequence[int] | None = None,
    format_options: dict[str, str] | None = None,
) -> Film:
    """Writes frames at these ticks of `base` (s)."""
    width, height = size
    numbers = range(len(ticks)) if numbers is None else numbers
    with av.open(str(path), "w", options=format_options or {}) as out:
        stream = out.add_stream(codec, rate=Fraction(30))
        stream.width, stream.height, stream.pix_fmt = width, height, pixels
        stream.codec_context.gop_size = gop
        stream.codec_context.time_base = base
        stream.time_base = base
        stream.options = options or {}
        for number, tick in zip(numbers, ticks, strict=True):
            frame = av.VideoFrame.from_ndarray(bars(number, width, height), format="rgb24")
            frame.pts, frame.time_base = tick, base
            out.mux(stream.encode(frame))
        out.mux(stream.encode(None))
    step = (ticks[-1] - ticks[-2]) * base
    return Film(path, [tick * base for tick in ticks], step)
