"""Vectors as a model gives them of films that are known: scenes of one world, over which a camera
moves, and copies of them.
"""

import hashlib
from pathlib import Path

import numpy as np

from kb.score.film_store import Vectors, keep_vectors

WIDTH, SECONDS, CLIP_S = 96, 64, 8
MODEL = "planted@0123456789abcdef"


class World:
    """What all its films have in common: a mean, and in which directions they differ."""

    def __init__(self, seed: int = 0, width: int = WIDTH) -> None:
        self._rng = np.random.default_rng(seed)
        self._mean = 3 * self._rng.standard_normal(width)
        self._spread = np.geomspace(1, 0.1, width)

    def film(self, seconds: int = SECONDS) -> np.ndarray:
        """float32 [seconds, width]: a scene of 5 to 12 s after the other."""
        frames: list[np.ndarray] = []
        while len(frames) < seconds:
            scene, moved = self._step(1.0), self._step(0.0)
            for _ in range(self._rng.integers(5, 13)):
                moved = 0.8 * moved + self._step(0.5)
                frames.append(self._mean + scene + moved)
        return np.array(frames[:seconds], np.float32)

    def copy(self, film: np.ndarray, shift: float = 1.0, noise: float = 0.1) -> np.ndarray:
        """What a change of brightness or edges does to all frames, and an encoder to each."""
        noises = noise * self._spread * self._rng.standard_normal(film.shape)
        return (film + self._step(shift) + noises).astype(np.float32)

    def _step(self, size: float) -> np.ndarray:
        return size * self._spread * self._rng.standard_normal(len(self._mean))


def clips_of(video_id: str, seconds: int = SECONDS) -> list[dict[str, object]]:
    """Clips side by side, as rows of pairs."""
    return [
        {
            "pair_id": hashlib.sha256(f"{video_id} {at}".encode()).hexdigest()[:16],
            "video_id": video_id,
            "clip_start_s": float(at),
            "clip_end_s": float(at + CLIP_S),
        }
        for at in range(0, seconds - CLIP_S + 1, CLIP_S)
    ]


def plant(root: Path, video_id: str, frames: np.ndarray, step_s: float = 1.0) -> None:
    """Store the vectors of a film."""
    stored = Vectors("film", dict(enumerate(frames.astype(np.float16))), {}, step_s)
    keep_vectors(root, video_id, MODEL, stored)
