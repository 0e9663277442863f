"""Duplicates by picture: which copies of planted films are found, and which other scenes of the
same world are taken for copies, by a small model that has learned its blocks in half a minute.

    make bench ARGS="-k film_copies"
"""

from collections.abc import Callable, Iterator
from fractions import Fraction
from pathlib import Path

import av
import cv2
import numpy as np
import pyarrow as pa
import pytest
import torch

from kb.score.film_pass import watch_film
from kb.score.film_store import Vectors, keep_vectors
from kb.score.models import ClipModel
from kb.score.visual_duplicates import visual_duplicates
from tests.score.checkpoints import of_openai, random_clip
from tests.score.planted_vectors import CLIP_S, clips_of

pytestmark = [pytest.mark.bench, pytest.mark.timeout(3600)]

WIDTH, HEIGHT, RATE, SECONDS = 320, 180, 4, 64
FILMS, COPIED, LEARNED, EPOCHS = 24, 12, 40, 6
BLOCK, KINDS = 20, 24  # px; kinds of blocks in the world

Frames = list[np.ndarray]


def _blocks() -> list[np.ndarray]:
    rng = np.random.default_rng(0)
    colours = rng.integers(30, 230, (KINDS, 1, 1, 3)) + rng.normal(0, 25, (KINDS, 5, 5, 3))
    return [np.kron(one.clip(0, 255), np.ones((4, 4, 1))).astype(np.uint8) for one in colours]


BLOCKS = _blocks()


def scene(rng: np.random.Generator) -> tuple[np.ndarray, list[int]]:
    """Hills of three kinds of blocks with some of a fourth kind, three pictures wide."""
    kinds = rng.choice(KINDS, 4, replace=False).tolist()
    columns, rows = 3 * WIDTH // BLOCK, HEIGHT // BLOCK
    wide = np.empty((HEIGHT, 3 * WIDTH, 3), np.uint8)
    wide[:] = rng.integers(90, 250, 3)
    heights = (4 + rng.integers(-1, 2, columns).cumsum()).clip(1, rows - 1)
    for column, height in enumerate(heights.tolist()):
        for row in range(rows - height, rows):
            kind = kinds[0] if row == rows - height else kinds[1 + int(rng.random() < 0.3)]
            wide[row * BLOCK :, column * BLOCK : (column + 1) * BLOCK][:BLOCK] = BLOCKS[kind]
    for _ in range(6):
        x, y = rng.integers(0, 3 * WIDTH - 40), rng.integers(0, HEIGHT - 60)
        wide[y : y + 60, x : x + 40] = np.tile(BLOCKS[kinds[3]], (3, 2, 1))
    return wide, kinds


def film(seed: int) -> Iterator[tuple[np.ndarray, list[int]]]:
    """RGB pictures and the blocks of their scene: scenes of 5 to 12 s over which a camera moves."""
    rng, left = np.random.default_rng(seed), 0
    for _ in range(SECONDS * RATE):
        if not left:
            (wide, kinds), left = scene(rng), int(rng.integers(5, 13)) * RATE
            x, speed = rng.uniform(0, 2 * WIDTH), rng.uniform(-60, 60) / RATE
        left -= 1
        if not 0 <= x + speed <= 2 * WIDTH:
            speed = -speed
        x += speed
        yield wide[:, int(x) : int(x) + WIDTH], kinds


def vectors_of_film(path: Path, frames: Frames, model: ClipModel, crf: int = 23) -> np.ndarray:
    """What a pass over the film stores."""
    with av.open(str(path), "w") as out:
        stream = out.add_stream("libx264", rate=Fraction(RATE))
        stream.height, stream.width = frames[0].shape[:2]
        stream.pix_fmt, stream.options = "yuv420p", {"preset": "ultrafast", "crf": str(crf)}
        for image in frames:
            picture = av.VideoFrame.from_ndarray(np.ascontiguousarray(image), format="rgb24")
            out.mux(stream.encode(picture))
        out.mux(stream.encode(None))
    return watch_film(path, range(SECONDS), model).vectors


def _cropped(frames: Frames) -> Frames:
    high, wide = HEIGHT // 20, WIDTH // 20
    return [image[high:-high, wide:-wide] for image in frames]


def _resized(frames: Frames) -> Frames:
    return [cv2.resize(image, (160, 90), interpolation=cv2.INTER_AREA) for image in frames]


def _brightened(frames: Frames) -> Frames:
    return [(image * 1.2 + 15).clip(0, 255).astype(np.uint8) for image in frames]


COPIES: dict[str, tuple[int, Callable[[Frames], Frames]]] = {
    "re-encoded": (38, list),
    "resized to a half": (28, _resized),
    "cropped by a tenth": (28, _cropped),
    "brightened": (23, _brightened),
    "mirrored": (23, lambda frames: [image[:, ::-1] for image in frames]),
}


@pytest.fixture(scope="module")
def models(tmp_path_factory: pytest.TempPathFactory) -> dict[str, ClipModel]:
    """A small CLIP with random weights, and one that was trained on frames and their blocks."""
    place, clip = tmp_path_factory.mktemp("models"), random_clip()
    torch.save(of_openai(clip), place / "random.pt")
    model = ClipModel(place / "random.pt")
    seen = [pair for seed in range(LEARNED) for pair in list(film(5000 + seed))[2::RATE]]
    squares = [image[:, (WIDTH - HEIGHT) // 2 : (WIDTH + HEIGHT) // 2] for image, _ in seen]
    pixels = np.stack([cv2.resize(one, (64, 64), interpolation=cv2.INTER_AREA) for one in squares])
    mean, std = (np.array(one) * 255 for one in model._rgb)
    inputs = torch.from_numpy(((pixels - mean) / std).astype(np.float32)).permute(0, 3, 1, 2)
    blocks = torch.tensor([sorted(kinds) for _, kinds in seen])
    words, unit = torch.nn.Embedding(KINDS, 64), torch.nn.functional.normalize
    learning = torch.optim.AdamW([*clip.parameters(), *words.parameters()], lr=1e-3)
    for _ in range(EPOCHS):
        for some in torch.randperm(len(inputs)).split(64):
            shown = unit(clip.get_image_features(inputs[some]).pooler_output, dim=-1)
            named = unit(words(blocks[some]).mean(1), dim=-1)
            same = (blocks[some][:, None] == blocks[some][None]).all(-1).float()
            right, logits = same / same.sum(1, keepdim=True), 15 * shown @ named.T
            entropy = torch.nn.functional.cross_entropy
            learning.zero_grad()
            (entropy(logits, right) + entropy(logits.T, right)).backward()
            learning.step()
    torch.save(of_openai(clip), place / "trained.pt")
    return {"trained": ClipModel(place / "trained.pt"), "random weights": model}


def test_film_copies_are_found(tmp_path: Path, models: dict[str, ClipModel]) -> None:
    films = [[image for image, _ in film(100 + number)] for number in range(FILMS)]
    for name, model in models.items():
        videos = []
        for number, frames in enumerate(films):
            copies = {kind: COPIES[kind] for kind in COPIES if number < COPIED}
            for kind, (crf, change) in {"original": (23, list), **copies}.items():
                vectors = vectors_of_film(tmp_path / "a.mp4", change(frames), model, crf)
                videos.append(f"{number:02} {kind}")
                stored = Vectors("film", dict(enumerate(vectors)))
                keep_vectors(tmp_path, videos[-1], name, stored)
        rows = [row for video in sorted(videos) for row in clips_of(video)]
        rows.sort(key=lambda row: (row["video_id"], row["pair_id"]))
        found = visual_duplicates(tmp_path, name, pa.Table.from_pylist(rows))
        shown = {row["pair_id"]: (row["video_id"], row["clip_start_s"]) for row in rows}
        first = {place: shown[found.get(pair, pair)] for pair, place in shown.items()}
        clusters: dict[object, set[object]] = {}
        for (video, start_s), leads in first.items():
            clusters.setdefault(leads, set()).add((str(video)[:2], start_s))
        wrong = np.mean([len(clusters[leads]) > 1 for leads in first.values()])
        recalls = {
            kind: np.mean(
                [
                    first[f"{number:02} {kind}", start_s] == first[f"{number:02} original", start_s]
                    for number in range(COPIED)
                    for start_s in np.arange(0.0, SECONDS, CLIP_S).tolist()
                ]
            )
            for kind in COPIES
        }
        print(name, {kind: f"{share:.1%}" for kind, share in recalls.items()}, f"wrong {wrong:.2%}")
        if name == "trained":
            assert min(share for kind, share in recalls.items() if kind != "mirrored") >= 0.95
            assert wrong <= 0.01
