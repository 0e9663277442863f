"""Films in which every cut, fade, flash, menu, pause screen and turn is known."""

from collections.abc import Callable, Iterator
from fractions import Fraction
from pathlib import Path
from typing import NamedTuple

import av
import cv2
import numpy as np

from tests.clips.films import in_own_thread

WIDTH, HEIGHT = 320, 180
KINDS = ("cut", "dissolve", "fade", "flash", "menu", "pause", "turn")
_WIDE = 3  # pictures that a scene is wide
_REST_S = 1.3  # after each event


class Event(NamedTuple):
    kind: str
    at_s: float


class Planted:
    """Frames (uint8 [HEIGHT, WIDTH, 3], BGR) of invented scenes over which a camera moves, with
    `each` events of the kinds asked for in random order.
    """

    def __init__(self, seed: int, rate: int, each: int, kinds: tuple[str, ...] = KINDS) -> None:
        self._rng = np.random.default_rng(seed)
        self._rate, self.number, self.events = rate, 0, list[Event]()
        self._order = self._rng.permutation(np.repeat(kinds, each)).tolist()
        self._new_scene()

    @property
    def now_s(self) -> float:
        return self.number / self._rate

    def frames(self) -> Iterator[np.ndarray]:
        yield from self._rest()
        for kind in self._order:
            planted: Callable[[], Iterator[np.ndarray]] = getattr(self, f"_{kind}")
            for image in planted():
                self.number += 1
                yield image.clip(0, 255).astype(np.uint8)
            yield from self._rest()

    def _rest(self) -> Iterator[np.ndarray]:
        for _ in range(round(_REST_S * self._rate)):
            self.number += 1
            yield self._step()

    def _note(self, kind: str, at_s: float | None = None) -> None:
        self.events.append(Event(kind, self.now_s if at_s is None else at_s))

    def _times(self, low_s: float, high_s: float) -> int:
        return max(1, round(self._rng.uniform(low_s, high_s) * self._rate))

    def _new_scene(self) -> None:
        self._scene = self._pattern(WIDTH * _WIDE, HEIGHT)
        self._x, self._speed = self._rng.uniform(WIDTH / 2, 1.5 * WIDTH), self._rng.uniform(-30, 30)

    def _pattern(self, width: int, height: int) -> np.ndarray:
        """Blocks of three sizes in six colours."""
        colours = self._rng.integers(30, 230, (6, 3)).astype(np.float32)
        image = np.zeros((height, width, 3), np.float32)
        for cell, share in ((45, 0.5), (22, 0.3), (10, 0.2)):
            blocks = colours[self._rng.integers(0, 6, (height // cell + 1, width // cell + 1))]
            image += share * cv2.resize(blocks, (width, height), interpolation=cv2.INTER_NEAREST)
        return image.astype(np.uint8)

    def _step(self, speed: float | None = None) -> np.ndarray:
        self._x += (self._speed if speed is None else speed) / self._rate
        if not 0 <= self._x <= WIDTH * (_WIDE - 1):
            self._speed = -self._speed
            self._x = min(max(self._x, 0), WIDTH * (_WIDE - 1))
        return self._scene[:, int(self._x) : int(self._x) + WIDTH]

    def _cut(self) -> Iterator[np.ndarray]:
        self._new_scene()
        self._note("cut")
        yield self._step()

    def _dissolve(self) -> Iterator[np.ndarray]:
        old, steps, start_s = self._step().astype(np.float32), self._times(0.5, 1.2), self.now_s
        self._new_scene()
        for step in range(1, steps + 1):
            yield old * (1 - step / steps) + self._step().astype(np.float32) * (step / steps)
        self._note("dissolve", (start_s + self.now_s) / 2)

    def _fade(self) -> Iterator[np.ndarray]:
        steps = self._times(0.3, 0.8)
        for step in range(1, steps + 1):
            yield self._step() * (1 - step / steps)
        start_s = self.now_s
        for _ in range(self._times(0.1, 0.6)):
            yield np.zeros((HEIGHT, WIDTH, 3))
        self._note("fade", (start_s + self.now_s) / 2)
        self._new_scene()
        for step in range(1, steps + 1):
            yield self._step() * (step / steps)

    def _flash(self) -> Iterator[np.ndarray]:
        self._note("flash")
        steps = self._times(0.03, 0.16)
        for share in (*[0.9] * steps, *np.linspace(0.8, 0, steps)):
            yield self._step() * (1 - share) + np.array([200, 240, 255]) * share

    def _menu(self) -> Iterator[np.ndarray]:
        frozen = self._step() * self._rng.uniform(0.3, 0.6)
        width = int(WIDTH * self._rng.uniform(0.35, 0.6))
        height = int(HEIGHT * self._rng.uniform(0.4, 0.75))
        left, top = (WIDTH - width) // 2, (HEIGHT - height) // 2
        frozen[top : top + height, left : left + width] = self._pattern(width, height) / 4 + 140
        self._note("menu")
        for _ in range(self._times(1.1, 2)):
            yield frozen
        self._note("menu")

    def _pause(self) -> Iterator[np.ndarray]:
        frozen = self._step() * 0.35
        for button in range(4):
            top = 40 + 26 * button
            frozen[top : top + 16, WIDTH // 3 : 2 * WIDTH // 3] = 120
        self._note("pause")
        for _ in range(self._times(1.1, 2)):
            yield frozen
        self._note("pause")

    def _turn(self) -> Iterator[np.ndarray]:
        self._note("turn")
        speed = self._rng.uniform(1.5, 5) * WIDTH * self._rng.choice([-1, 1])
        for _ in range(self._times(0.15, 0.5)):
            yield self._step(speed)


@in_own_thread
def write_planted(path: Path, planted: Planted, rate: int, codec: str) -> None:
    """Write its frames as a film."""
    fast = {
        "libx264": {"preset": "ultrafast", "crf": "23"},
        "libvpx-vp9": {"deadline": "realtime", "cpu-used": "8", "b": "2M"},
        "libsvtav1": {"preset": "12", "crf": "35", "svtav1-params": "lp=1"},  # more may deadlock
    }
    with av.open(str(path), "w") as out:
        stream = out.add_stream(codec, rate=Fraction(rate))
        stream.width, stream.height, stream.pix_fmt = WIDTH, HEIGHT, "yuv420p"
        stream.options = fast[codec]
        for image in planted.frames():
            frame = av.VideoFrame.from_ndarray(np.ascontiguousarray(image), format="bgr24")
            out.mux(stream.encode(frame))
        out.mux(stream.encode(None))


class Hits(NamedTuple):
    """How well events of a kind were found."""

    planted: int
    found: int
    right: int

    @property
    def f1(self) -> float:
        return 2 * self.right / max(1, self.planted + self.found)


def hits(planted: list[float], found: list[float], within_s: float) -> Hits:
    """Each planted time counts for one found time at most."""
    left, right = sorted(found), 0
    for at_s in planted:
        near = [time for time in left if abs(time - at_s) <= within_s]
        if near:
            left.remove(min(near, key=lambda time: abs(time - at_s)))
            right += 1
    return Hits(len(planted), len(found), right)
