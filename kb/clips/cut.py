"""Cuts all clips of a film in one pass."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

from kb.clips.frames import Fit, frames_at
from kb.core.installation import np


def frame_times(start_s: float, end_s: float, frames: int) -> np.ndarray:
    """The centres of as many equal parts of a clip (s, float64)."""
    return start_s + (np.arange(frames) + 0.5) / frames * (end_s - start_s)


def cut(
    path: Path, times_s: Sequence[np.ndarray], size: tuple[int, int], fit: Fit
) -> Iterator[tuple[int, np.ndarray]]:
    """Each clip by its number, with its frames: uint8 [frames, height, width, 3], RGB.

    `times_s`: of the frames of each clip (`frame_times`). Clips come in the order of their ends;
    those that the film is too short for are left out. Clips that overlap share the decoding, and
    only they are in memory together. Raises UndecodableVideo, behind the clips before the fault.
    """
    clips = np.repeat(np.arange(len(times_s)), [len(one) for one in times_s])
    times = np.concatenate([*times_s, np.zeros(0)])
    order = np.argsort(times, kind="stable")
    cutting: dict[int, list[np.ndarray]] = {}
    shown = frames_at(path, times[order].tolist(), size, fit)
    for clip, image in zip(clips[order].tolist(), shown, strict=False):
        images = cutting.setdefault(clip, [])
        images.append(image)
        if len(images) == len(times_s[clip]):
            yield clip, np.stack(cutting.pop(clip))
