"""`kb pairs align` by a small CLIP that is trained here on planted pictures and words."""

import random
from pathlib import Path

import numpy as np
import pytest

from tests.conftest import needs

needs("av", "cv2", "scenedetect", "torch", "transformers")

from kb.core.installation import torch  # noqa: E402
from kb.pairs.clip_tokens import token_ids  # noqa: E402
from kb.sandbox.youtube.films import drawn, timeline, write_film  # noqa: E402
from kb.score.calibration import area  # noqa: E402
from tests.score.alignment_world import FILLER, AlignmentWorld, measured  # noqa: E402

pytestmark = [pytest.mark.slow, pytest.mark.timeout(900)]

NAMES = ["Creeper", "Skeleton", "Enderman", "Zombie", "Spider", "Slime", "Ghast", "Blaze", "Witch"]
FILMS, MENTIONS, EVERY_S = 8, 12, 45
STEPS, SIDE = 200, 64


def trained(path: Path) -> Path:
    """A model that has seen the pictures of all names, among them nothing, and read of them."""
    import cv2
    from transformers import CLIPConfig, CLIPModel  # every test process would load them for seconds

    torch.manual_seed(0)
    part = {
        "hidden_size": 64,
        "intermediate_size": 128,
        "num_hidden_layers": 2,
        "num_attention_heads": 1,
    }
    text = {**part, "eos_token_id": 49_407}
    vision = {**part, "image_size": SIDE, "patch_size": 16}
    model = CLIPModel(CLIPConfig(text_config=text, vision_config=vision, projection_dim=64))
    rng = random.Random(0)
    mean, std = (
        torch.tensor(values).view(3, 1, 1)
        for values in ((0.48145466, 0.4578275, 0.40821073), (0.26862954, 0.26130258, 0.27577711))
    )

    def pixels(picture: tuple[str, ...]) -> "torch.Tensor":
        image = cv2.resize(drawn(picture)[:, 48:-48], (SIDE, SIDE), interpolation=cv2.INTER_AREA)
        image = image + np.random.default_rng(rng.randrange(1 << 30)).normal(size=image.shape) * 3
        return (torch.from_numpy(image).permute(2, 0, 1).float() / 255 - mean) / std

    threads = torch.get_num_threads()
    torch.set_num_threads(1)  # of so small a model threads wait for each other
    optimizer = torch.optim.Adam(model.parameters(), lr=1e-3)
    for _ in range(STEPS):
        shown = [(name, *rng.sample(NAMES, rng.random() < 0.2)) for name in NAMES]
        words = [
            " ".join(rng.choices(FILLER.split(), k=rng.randrange(4, 12))).split() for _ in NAMES
        ]
        for line, name in zip(words, NAMES, strict=True):
            line.insert(rng.randrange(len(line)), name.lower())
        ids = torch.from_numpy(np.stack([token_ids(" ".join(line)) for line in words]))
        images = torch.stack([pixels(tuple(sorted({*own}))) for own in [*shown, ()]])
        found = model(
            input_ids=ids[:, : int((ids != 0).sum(1).max())], pixel_values=images
        ).logits_per_text
        wanted = torch.arange(len(NAMES))
        loss = torch.nn.functional.cross_entropy(found, wanted)
        loss = loss + torch.nn.functional.cross_entropy(found.T[:-1], wanted)
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
    torch.set_num_threads(threads)
    model.eval().save_pretrained(path)
    return path


def test_films_that_show_what_is_named_before_with_after_or_never(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    world = AlignmentWorld(tmp_path / "w", NAMES, FILMS, MENTIONS, EVERY_S)
    films = tmp_path / "films"
    films.mkdir()
    for video in world.mentions:
        write_film(films / f"{video}.mp4", timeline(world.shown(video), world.seconds))
    model = trained(tmp_path / "small")
    done = world.kb("pairs", "score", "--videos", films, "--model", model, "--workers", "1")
    assert done.code == 0, done.err
    done = world.kb("pairs", "align")
    assert done.code == 0, done.err
    found = measured(world)
    told = area(found.alignable[found.shown], found.alignable[~found.shown])
    assert told is not None
    with capsys.disabled():
        print(
            f"\n{len(found.shown)} pairs of {FILMS} films; alignable {len(found.errors)} of"
            f" {found.shown.sum()} that are shown; median error {np.median(found.errors):.2f} s;"
            f" area under the curve {told['auc']:.3f} ({told['low']:.3f} to {told['high']:.3f});"
            f" clips that show their word: {found.share_aligned:.3f} at aligned times,"
            f" {found.share_spoken:.3f} at spoken ones"
        )
    assert np.median(found.errors) <= 1
    assert told["auc"] >= 0.95
    # Whichever clips at spoken times make up the same number, no more than this share shows it.
    most = found.share_spoken * len(found.shown) / len(found.errors)
    assert found.share_aligned >= most + 0.1
