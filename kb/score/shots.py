"""Where the shots of a film begin, found frame by frame while it is decoded.

A cut is where PySceneDetect's AdaptiveDetector sees one frame that differs from the one before by
much more than their neighbours do. Its candidates include menus, pause screens and flashes, after
which the same scene goes on. So a candidate counts only if within a second no picture comes that
shows the scene before it again: parts of the picture are compared by their normalised
correlation, which neither darkening nor brightening changes, and may have moved a little.

A fade is where ThresholdDetector sees the picture go to black and come back; the new shot begins in
the middle. Dissolves are not looked for.

Sources: scenedetect.com, "Detection Algorithms"; Lewis, "Fast Normalized Cross-Correlation" (1995).
"""

from __future__ import annotations

from collections import deque
from typing import TYPE_CHECKING, NamedTuple

from kb.core.installation import np

if TYPE_CHECKING:
    from scenedetect import FrameTimecode

WIDTH, HEIGHT = 160, 90  # px of the frames that are compared
BLACK = 12  # mean value (0 to 255) below which a picture is black
SHORTEST_S = 0.3  # of a shot
START, CUT, FADE = "start", "cut", "fade"
_FADING_S = 0.8  # around the middle of a fade no cut is looked for
_BEFORE_S = 0.5  # the scene before is taken from this time, as a flash hides it
_AGAIN_S = 1.0  # after a menu opened or a flash began, the scene is seen again within this time
_KEPT_S = _BEFORE_S + _AGAIN_S + 2.5  # of pictures; fades and cuts are known some frames late
_LEAST = 8  # pictures that are kept however far apart they are
_STEPS = 10  # pictures of that time that are compared
_PART = 15, 16  # height and width of a part of the grey picture, px; the picture is half as large
_MOVED = 5  # px that a part may have moved
_ALIKE = 0.8  # correlation from which on a part is the same
_SAME_SCENE = 0.3  # share of the parts with a pattern from which on the scene is the same
_PATTERN = 3.0  # standard deviation from which on a part has a pattern


class Shot(NamedTuple):
    """`kind` says how it begins: with the film, a cut or a fade."""

    start_s: float
    end_s: float
    kind: str


class ShotFinder:
    """Takes the frames of a film in order, and gives its shots at the end.

    Memory holds the grey pictures of the last seconds.
    """

    def __init__(self) -> None:
        from scenedetect.detectors import (
            AdaptiveDetector,
            ThresholdDetector,
        )

        self._cuts = AdaptiveDetector(min_scene_len=1)
        self._fades = ThresholdDetector(threshold=BLACK, min_scene_len=1)
        self._number = 0
        self._times = deque[float]()  # of the pictures in `_grey`
        self._grey = deque[np.ndarray]()
        self._first = 0  # the number of the first picture in `_grey`
        self._waiting = deque[int]()  # frames that may begin a shot after a cut
        self._starts = list[tuple[float, str]]()
        self._black = deque[tuple[int, float]](maxlen=2)

    def take(self, time_s: float, image: np.ndarray) -> None:
        """The next frame: uint8 [HEIGHT, WIDTH, 3], BGR, and when it is shown."""
        frame = _timecode(self._number)
        if not self._number:
            self._starts.append((time_s, START))
        self._grey.append(np.ascontiguousarray(image[::2, ::2, 1]))
        self._times.append(time_s)
        self._waiting.extend(cut.frame_num for cut in self._cuts.process_frame(frame, image))
        for fade in self._fades.process_frame(frame, image):
            self._fade(fade.frame_num)
        self._number += 1
        while self._waiting and time_s - self._time(self._waiting[0]) > _AGAIN_S:
            self._judge(self._waiting.popleft())
        while len(self._times) > _LEAST and time_s - self._times[0] > _KEPT_S:
            self._grey.popleft()
            self._times.popleft()
            self._first += 1

    def shots(self, end_s: float) -> list[Shot]:
        """All shots; call it once, when the film has ended."""
        while self._waiting:
            self._judge(self._waiting.popleft())
        starts = sorted(self._starts)
        fades = [start for start, kind in starts if kind == FADE]
        kept: list[tuple[float, str]] = []
        for start, kind in starts:
            near = any(abs(start - fade) < _FADING_S for fade in fades)
            if kind == CUT and (near or start - kept[-1][0] < SHORTEST_S):
                continue
            kept.append((start, kind))
        ends = [start for start, _ in kept[1:]] + [end_s]
        return [Shot(start, end, kind) for (start, kind), end in zip(kept, ends, strict=True)]

    def _time(self, number: int) -> float:
        return self._times[max(0, number - self._first)]

    def _fade(self, middle: int) -> None:
        self._starts.append((self._time(middle), FADE))

    def _judge(self, number: int) -> None:
        """Note a cut before this frame, unless the scene goes on."""
        place, times = number - self._first, np.array(self._times)
        if place < 1:
            return
        first = int(np.searchsorted(times, times[place] - _BEFORE_S))
        last = int(np.searchsorted(times, times[place] + _AGAIN_S))
        before = {place - 1, *_spread(first, place - 1, _STEPS // 2)}
        after = _spread(place, max(place, last - 1), _STEPS)
        if not any(same_scene(self._grey[a], self._grey[b]) for a in before for b in after):
            self._starts.append((float(times[place]), CUT))


def _spread(first: int, last: int, steps: int) -> list[int]:
    """Numbers from the first to the last one, evenly spread."""
    return sorted(set(np.linspace(first, last, steps).round().astype(int).tolist()))


def same_scene(before: np.ndarray, after: np.ndarray) -> bool:
    """Whether two grey pictures show the same scene, though one may be darkened, brightened, partly
    covered or moved a little.
    """
    import cv2

    there = cv2.copyMakeBorder(after, _MOVED, _MOVED, _MOVED, _MOVED, cv2.BORDER_REPLICATE)
    height, width = _PART
    alike = parts = 0
    for top in range(0, before.shape[0] - height + 1, height):
        for left in range(0, before.shape[1] - width + 1, width):
            part = before[top : top + height, left : left + width]
            if part.std() < _PATTERN:
                continue
            around = there[top : top + height + 2 * _MOVED, left : left + width + 2 * _MOVED]
            parts += 1
            alike += bool(cv2.matchTemplate(around, part, cv2.TM_CCOEFF_NORMED).max() > _ALIKE)
    if parts > 0 and alike / parts >= _SAME_SCENE:
        return True
    # The camera turned: half of the picture is now elsewhere.
    middle = before.shape[1] // 2
    halves = (half[_MOVED:-_MOVED] for half in (before[:, :middle], before[:, middle:]))
    return any(
        half.std() >= _PATTERN
        and cv2.matchTemplate(after, half, cv2.TM_CCOEFF_NORMED).max() > _ALIKE
        for half in halves
    )


def _timecode(number: int) -> FrameTimecode:
    """Frames are counted; their times are kept apart, as many films have no fixed rate."""
    from scenedetect import FrameTimecode

    return FrameTimecode(number, fps=25.0)
