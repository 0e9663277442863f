"""CLIP checkpoints of four formats: the same weights give the same embeddings."""

import pickle
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from kb.core.errors import MissingModel
from kb.core.installation import torch
from tests.conftest import needs

needs("av", "torch", "transformers")

from kb.pairs.clip_tokens import token_ids  # noqa: E402
from kb.score.models import ClipModel  # noqa: E402

SIDE = 64  # px of the pictures of the small models
TEXTS = ["a creeper explodes", "how to build a house", "x" * 400]


def checkpoints() -> Any:
    """The module, loaded late: torch takes seconds, and every process collects this file."""
    from tests.score import checkpoints

    return checkpoints


def openai_weights(*vocabulary: int) -> Any:
    return checkpoints().of_openai(checkpoints().random_clip(*vocabulary))


def images(height: int, width: int, count: int = 3) -> list[np.ndarray]:
    return list(np.random.default_rng(0).integers(0, 255, (count, height, width, 3), np.uint8))


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The same weights as transformers, OpenAI and open_clip store them."""
    made = tmp_path_factory.mktemp("models")
    model = checkpoints().random_clip()
    model.save_pretrained(made / "transformers")
    weights = checkpoints().of_openai(model)
    torch.save(weights, made / "openai.pt")
    halves = {name: one.half() if "ln_" not in name else one for name, one in weights.items()}
    torch.save(halves, made / "halves.pt")
    torch.save({"state_dict": {f"module.{k}": v for k, v in weights.items()}}, made / "train.pt")
    from safetensors.torch import save_file

    save_file({name: one.contiguous() for name, one in weights.items()}, made / "o.safetensors")
    return made


@pytest.fixture(scope="module")
def expected() -> tuple[np.ndarray, np.ndarray]:
    """What transformers itself makes of frames and texts."""
    model = checkpoints().random_clip()
    mean = torch.tensor([0.48145466, 0.4578275, 0.40821073]).view(3, 1, 1)
    std = torch.tensor([0.26862954, 0.26130258, 0.27577711]).view(3, 1, 1)
    pixels = torch.tensor(np.stack(images(SIDE, SIDE))).permute(0, 3, 1, 2) / 255
    tokens = torch.tensor(np.stack([token_ids(text) for text in TEXTS]))
    with torch.no_grad():
        frames = model.get_image_features(pixel_values=(pixels - mean) / std).pooler_output
        texts = model.get_text_features(input_ids=tokens).pooler_output
    return frames.numpy(), torch.nn.functional.normalize(texts, dim=-1).numpy()


@pytest.mark.parametrize(
    ("name", "apart"),
    [
        ("transformers", 1e-5),
        ("openai.pt", 1e-5),
        ("train.pt", 1e-5),
        ("o.safetensors", 1e-5),
        ("halves.pt", 0.03),
    ],
)
def test_the_same_weights_give_the_same_embeddings(
    folder: Path, expected: tuple[np.ndarray, np.ndarray], name: str, apart: float
) -> None:
    model = ClipModel(folder / name)
    assert model.size == (SIDE, SIDE)
    assert np.abs(model.frames(images(SIDE, SIDE)) - expected[0]).max() < apart
    assert np.abs(model.texts(TEXTS) - expected[1]).max() < apart


def test_open_clip_says_which_activation_it_has(folder: Path, tmp_path: Path) -> None:
    """Its own models have the exact one, which no weight tells; the file beside them does."""
    torch.save(
        openai_weights(),
        tmp_path / "open_clip_pytorch_model.bin",
    )
    quick = ClipModel(tmp_path / "open_clip_pytorch_model.bin").texts(TEXTS)
    (tmp_path / "open_clip_config.json").write_text('{"model_cfg": {"embed_dim": 64}}')
    exact = ClipModel(tmp_path / "open_clip_pytorch_model.bin").texts(TEXTS)
    assert 1e-4 < np.abs(quick - exact).max() < 0.2


def test_mineclip_is_read_as_it_was_published(tmp_path: Path) -> None:
    made = checkpoints().MineClip()
    model = ClipModel(made.save(tmp_path / "attn.pth"))
    assert (model.size, model.fit) == ((160, 256), "stretch")
    given = images(160, 256, 16)
    mean = torch.tensor([0.3331, 0.3245, 0.3051]).view(3, 1, 1)
    std = torch.tensor([0.2439, 0.2493, 0.2873]).view(3, 1, 1)
    pixels = (torch.tensor(np.stack(given)).permute(0, 3, 1, 2) / 255 - mean) / std
    tokens = torch.tensor(np.stack([token_ids(text) for text in TEXTS]))
    with torch.no_grad():
        frames = made.image_encoder(pixels)
        texts = torch.nn.functional.normalize(made.clip_model.text_model(tokens), dim=-1)
        clip = made.clip(frames)
    found = model.frames(given)
    assert np.abs(found - frames.numpy()).max() < 1e-5
    assert np.abs(model.texts(TEXTS) - texts.numpy()).max() < 1e-5
    assert np.abs(model.clip(found) - clip.numpy()).max() < 1e-5


class _Code:
    def __reduce__(self) -> tuple[object, tuple[str]]:
        return Path.touch, (Path("ran"),)  # type: ignore[return-value]


def _pickled(path: Path) -> None:
    path.write_bytes(pickle.dumps({"state_dict": _Code()}))


def _cut_off(path: Path) -> None:
    torch.save(openai_weights(), path)
    path.write_bytes(path.read_bytes()[:10_000])


def _lacks_weights(path: Path) -> None:
    weights = openai_weights()
    del weights["visual.ln_post.bias"]
    torch.save(weights, path)


@pytest.mark.parametrize(
    ("make", "said"),
    [
        (_pickled, "can be read"),
        (_cut_off, "can be read"),
        (_lacks_weights, "post_layernorm.bias"),
        (lambda path: path.write_bytes(b"<html>"), "can be read"),
        (lambda path: torch.save({"layer.weight": torch.ones(3)}, path), "no weights of a known"),
        (
            lambda path: torch.save(openai_weights(300), path),
            "knows 300 tokens",
        ),
        (lambda path: torch.save([1, 2], path), "holds no state dict"),
        (
            lambda path: torch.jit.script(torch.nn.Linear(2, 2)).save(str(path)),
            "is a TorchScript archive",
        ),
    ],
)
def test_another_file_is_one_clear_error(tmp_path, monkeypatch, make, said: str) -> None:
    monkeypatch.chdir(tmp_path)
    make(tmp_path / "model.pt")
    with pytest.raises(MissingModel, match=said):
        ClipModel(tmp_path / "model.pt")
    assert not Path("ran").exists()


def test_a_folder_of_another_model_is_one_clear_error(tmp_path: Path) -> None:
    (tmp_path / "config.json").write_text('{"model_type": "bert"}')
    with pytest.raises(MissingModel, match="model_type clip"):
        ClipModel(tmp_path)
