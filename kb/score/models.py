"""CLIP checkpoints as one model: frames and texts become embeddings.

Four formats are read. All of them run as `CLIPModel` of transformers, by the names of its weights:

- a folder of transformers (config.json with model.safetensors or pytorch_model.bin)
- a state dict of OpenAI's CLIP, and one of open_clip, which has the same names
- a state dict of MineCLIP: CLIP with other names, a temporal transformer over the frames of a clip,
  and an adapter behind it

A file is a pickle (.pt, .pth, .bin, .ckpt), of which nothing but tensors is loaded, or safetensors.

Sources: Radford et al., "Learning Transferable Visual Models From Natural Language Supervision"
(2021); Fan et al., "MineDojo" (2022), appendix on MineCLIP. The temporal transformer is that of
x-transformers 0.27.1, with which MineCLIP was published.
"""

from __future__ import annotations

import hashlib
import json
import re
import warnings
from collections.abc import Mapping, Sequence
from functools import lru_cache
from pathlib import Path, PurePosixPath
from typing import TYPE_CHECKING, Any
from urllib.parse import urlsplit

from kb.annotate.fetch import download
from kb.core.config.profile import Profile
from kb.core.context import Run
from kb.core.errors import MissingModel, ProfileError
from kb.core.installation import np, require, torch
from kb.core.summary import Summary
from kb.pairs.clip_tokens import token_ids
from kb.store.checkpoint import models_folder
from kb.store.tables import checksums

if TYPE_CHECKING:
    from transformers import CLIPModel

    from kb.clips.frames import Fit

    Weights = dict[str, torch.Tensor]

EXTRA = ("av", "tokenizers", "torch", "transformers")
BATCH = 32  # frames, or texts, of one pass
_CLIP_RGB = (0.48145466, 0.4578275, 0.40821073), (0.26862954, 0.26130258, 0.27577711)
_MINECLIP_RGB = (0.3331, 0.3245, 0.3051), (0.2439, 0.2493, 0.2873)
_MINECLIP_SIZE = 160, 256  # height and width of its frames, px
_MINECLIP_FRAMES = 16  # of a clip
_HEAD = 64  # width of an attention head, in every published model
_END = 49_407  # the token that ends a text
_VOCABULARY = 49_408

# Names of MineCLIP → names of OpenAI's CLIP → names of transformers. Each is the beginning of a
# name or, behind the number of a block, the rest of it.
_OF_MINECLIP = {
    "clip_model.vision_model.cls_token": "visual.class_embedding",
    "clip_model.vision_model.pos_embed": "visual.positional_embedding",
    "clip_model.vision_model.projection": "visual.proj",
    "clip_model.vision_model.blocks.": "visual.transformer.resblocks.",
    "clip_model.vision_model.": "visual.",
    "clip_model.text_model.pos_embed": "positional_embedding",
    "clip_model.text_model.projection": "text_projection",
    "clip_model.text_model.blocks.": "transformer.resblocks.",
    "clip_model.text_model.": "",
    "clip_model.": "",
}
_OF_OPENAI = {
    "visual.class_embedding": "vision_model.embeddings.class_embedding",
    "visual.conv1.": "vision_model.embeddings.patch_embedding.",
    "visual.positional_embedding": "vision_model.embeddings.position_embedding.weight",
    "visual.ln_pre.": "vision_model.pre_layrnorm.",
    "visual.ln_post.": "vision_model.post_layernorm.",
    "visual.proj": "visual_projection.weight",
    "visual.transformer.resblocks.": "vision_model.encoder.layers.",
    "token_embedding.": "text_model.embeddings.token_embedding.",
    "positional_embedding": "text_model.embeddings.position_embedding.weight",
    "ln_final.": "text_model.final_layer_norm.",
    "text_projection": "text_projection.weight",
    "transformer.resblocks.": "text_model.encoder.layers.",
    "logit_scale": "logit_scale",
}
_OF_BLOCK = {
    "attn.out_proj.": "self_attn.out_proj.",
    "ln_1.": "layer_norm1.",
    "ln_2.": "layer_norm2.",
    "mlp.c_fc.": "mlp.fc1.",
    "mlp.c_proj.": "mlp.fc2.",
}


class ClipModel:
    """A loaded checkpoint.

    size      height and width of a frame (px)
    fit       how a frame of another ratio becomes one of that size
    step_s    seconds between two frames of a clip
    """

    def __init__(self, path: Path, device: str = "cpu") -> None:
        """Raises MissingModel for what is not a checkpoint of a known format, MissingExtra."""
        require("score", *EXTRA)
        self.device = device
        self.size, self.step_s = (224, 224), 1.0
        self.fit: Fit = "crop"
        self._rgb = _CLIP_RGB
        self._temporal: Weights = {}
        self._adapter: Weights = {}
        try:
            model = self._of_folder(path) if path.is_dir() else self._of_file(path)
        except MissingModel:
            raise
        except Exception as error:  # noqa: BLE001  whatever the libraries make of a stranger's file
            what = " ".join(str(error).split())[:200] or type(error).__name__
            raise MissingModel(
                f"{path} is not a CLIP checkpoint that can be read: {what}", hint=_FORMATS
            ) from None
        if model.config.text_config.vocab_size < _VOCABULARY:
            raise MissingModel(
                f"{path} knows {model.config.text_config.vocab_size:,} tokens, not CLIP's"
                f" {_VOCABULARY:,}",
                hint="give a model that was trained with CLIP's tokenizer",
            )
        self._model = model.to(device).eval()

    def _of_folder(self, path: Path) -> CLIPModel:
        from transformers import CLIPModel
        from transformers.utils import logging

        logging.disable_progress_bar()
        config = _json(path / "config.json")
        if config.get("model_type") != "clip":
            raise MissingModel(
                f"{path} is not a CLIP model of transformers: its config.json does not say"
                " model_type clip",
                hint=_FORMATS,
            )
        shown = _json(path / "preprocessor_config.json")
        if "image_mean" in shown and "image_std" in shown:
            self._rgb = tuple(shown["image_mean"]), tuple(shown["image_std"])
        model = CLIPModel.from_pretrained(path, local_files_only=True, dtype=torch.float32)
        side = model.config.vision_config.image_size
        self.size = side, side
        return model

    def _of_file(self, path: Path) -> CLIPModel:
        weights = _plain(_weights(path))
        if any(name.startswith("clip_model.") for name in weights):
            return self._of_mineclip(weights)
        if "visual.conv1.weight" not in weights or "token_embedding.weight" not in weights:
            raise MissingModel(f"{path} has no weights of a known CLIP", hint=_FORMATS)
        about = _json(path.with_name("open_clip_config.json")).get("model_cfg", {})
        quick = about.get("quick_gelu", False) if about else True
        model = _assembled(weights, "quick_gelu" if quick else "gelu")
        side = model.config.vision_config.image_size
        self.size = side, side
        return model

    def _of_mineclip(self, weights: Weights) -> CLIPModel:
        self.size, self.fit, self._rgb, self.step_s = _MINECLIP_SIZE, "stretch", _MINECLIP_RGB, 0.5
        self._temporal = _below(weights, "temporal_encoder.attn.model.", self.device)
        self._adapter = _below(weights, "reward_head.video_", self.device)
        renamed = {
            _renamed(name, _OF_MINECLIP): tensor
            for name, tensor in weights.items()
            if name.startswith("clip_model.")
        }
        return _assembled(renamed, "quick_gelu")

    def frames(self, images: Sequence[np.ndarray]) -> np.ndarray:
        """An embedding for each frame (uint8 [height, width, 3], RGB): float32 [frames, width]."""
        features = [np.zeros((0, self._model.config.projection_dim), np.float32)]
        mean, std = (
            torch.tensor(one, device=self.device).view(1, 3, 1, 1) * 255 for one in self._rgb
        )
        vision = self._model.vision_model
        with torch.inference_mode():
            for at in range(0, len(images), BATCH):
                pixels = torch.from_numpy(np.stack(images[at : at + BATCH])).to(self.device)
                pixels = (pixels.permute(0, 3, 1, 2).float() - mean) / std
                # As `vision_model` does, but for frames that are not square.
                patches = vision.embeddings.patch_embedding(pixels).flatten(2).transpose(1, 2)
                first = vision.embeddings.class_embedding.expand(len(pixels), 1, -1)
                hidden = torch.cat((first, patches), 1)
                hidden = vision.pre_layrnorm(hidden + vision.embeddings.position_embedding.weight)
                hidden = vision.encoder(inputs_embeds=hidden).last_hidden_state[:, 0]
                embedded = self._model.visual_projection(vision.post_layernorm(hidden))
                features.append(embedded.cpu().numpy())
        return np.concatenate(features)

    def texts(self, texts: Sequence[str]) -> np.ndarray:
        """An embedding of length 1 for each text: float32 [texts, width]."""
        features = [np.zeros((0, self._model.config.projection_dim), np.float32)]
        with torch.inference_mode():
            for at in range(0, len(texts), BATCH):
                ids = np.stack([token_ids(text) for text in texts[at : at + BATCH]])
                ids = ids[:, : (ids != 0).sum(axis=1).max()]
                embedded = self._model.get_text_features(
                    torch.from_numpy(ids).to(self.device)
                ).pooler_output
                features.append(embedded.cpu().numpy())
        return unit(np.concatenate(features))

    def clip(self, frames: np.ndarray) -> np.ndarray:
        """The embedding of a clip from those of its frames: the mean of those of length 1, or what
        the model's temporal transformer and adapter make of them.
        """
        if not (self._temporal or self._adapter):
            return unit(frames).mean(axis=0)
        # As many as it was trained with, evenly over the clip.
        places = ((np.arange(_MINECLIP_FRAMES) + 0.5) / _MINECLIP_FRAMES * len(frames)).astype(int)
        with torch.inference_mode():
            taken = torch.from_numpy(frames[places]).to(self.device)
            pooled = _pooled(taken, self._temporal) if self._temporal else taken.mean(0)
            return unit(_adapted(pooled, self._adapter).cpu().numpy())


_FORMATS = (
    "give a folder of transformers, or a state dict of OpenAI's CLIP, open_clip (ViT) or MineCLIP"
)


def checkpoint_file(profile: Profile) -> Path:
    """Where `kb models fetch clip` stores the checkpoint that the profile names, in a folder of its
    own. Raises ProfileError where it names none.
    """
    named = profile.score.checkpoint
    if named.url is None or named.sha256 is None:
        raise ProfileError(
            f"profile {profile.name!r} names no CLIP model",
            hint="give `kb pairs score` --model FILE, or name one in the profile:"
            ' score.checkpoint = { url = "https://…", sha256 = "…" }',
        )
    name = PurePosixPath(urlsplit(named.url).path).name or "clip.pt"
    return models_folder("clip") / named.sha256[:16] / name


def fetch(run: Run) -> Summary:
    """`kb models fetch clip`. Raises ProfileError, and what `kb.annotate.fetch.download` does."""
    path = checkpoint_file(run.profile)
    named = run.profile.score.checkpoint
    source = (path.name, str(named.url), str(named.sha256))
    return download(run, "clip", [source], path.parent)


def unit(vectors: np.ndarray) -> np.ndarray:
    """Vectors of length 1, along the last axis."""
    return vectors / np.maximum(np.linalg.norm(vectors, axis=-1, keepdims=True), 1e-12)


def model_name(path: Path) -> str:
    """Name and digest of a checkpoint: "ViT-B-16@0123456789abcdef". Raises MissingModel."""
    require("score", *EXTRA)
    files = [path]
    if path.is_dir():
        files = sorted([*path.glob("*.safetensors"), *path.glob("*.bin"), path / "config.json"])
    try:
        stamps = [(file, (about := file.stat()).st_size, about.st_mtime_ns) for file in files]
        digest = _digest_of(tuple(stamps))
    except OSError as error:
        raise MissingModel(
            f"{error.filename or path} can't be read: {error.strerror}", hint=_FORMATS
        ) from None
    return f"{path.name.removesuffix(path.suffix) if path.is_file() else path.name}@" + digest[:16]


@lru_cache(maxsize=4)  # explore asks at each search of clips
def _digest_of(stamps: tuple[tuple[Path, int, int], ...]) -> str:
    """The digest of these files, which have these sizes and times. Raises OSError."""
    digest = hashlib.sha256()
    for file, _, _ in stamps:
        digest.update(checksums.digest(file).encode())
    return digest.hexdigest()


def _json(path: Path) -> dict[str, Any]:
    config = json.loads(path.read_text(encoding="utf-8")) if path.is_file() else {}
    return config if isinstance(config, dict) else {}


def _weights(path: Path) -> Mapping[str, Any]:
    if path.suffix == ".safetensors":
        from safetensors.torch import load_file  # noqa: PLC0415  comes with transformers

        return load_file(path)
    try:
        with warnings.catch_warnings(action="ignore"):  # about formats, which are refused anyhow
            weights = torch.load(path, map_location="cpu", weights_only=True)
    except Exception as error:  # noqa: BLE001  whatever torch makes of a stranger's file
        if "TorchScript" in str(error):
            raise MissingModel(
                f"{path} is a TorchScript archive, which has code besides its weights",
                hint="if you trust it, save its weights alone:"
                " torch.save(torch.jit.load(FILE).state_dict(), OTHER_FILE)",
            ) from None
        # What torch says would be to load it with its code.
        raise MissingModel(
            f"{path} is not a CLIP checkpoint that can be read: it is damaged, no file of PyTorch,"
            " or has more than tensors",
            hint=_FORMATS,
        ) from None
    for name in ("state_dict", "model"):
        if isinstance(weights, Mapping) and isinstance(weights.get(name), Mapping):
            weights = weights[name]
    if not isinstance(weights, Mapping):
        raise MissingModel(f"{path} holds no state dict", hint=_FORMATS)
    return weights


def _plain(weights: Mapping[str, Any]) -> Weights:
    """The tensors in single precision, without what trainers put before all names."""
    tensors = {name: one.float() for name, one in weights.items() if isinstance(one, torch.Tensor)}
    for prefix in ("module.", "model."):
        if tensors and all(name.startswith(prefix) for name in tensors):
            tensors = {name.removeprefix(prefix): one for name, one in tensors.items()}
    return tensors


def _below(weights: Weights, prefix: str, device: str) -> Weights:
    return {
        name.removeprefix(prefix): tensor.to(device)
        for name, tensor in weights.items()
        if name.startswith(prefix)
    }


def _renamed(name: str, names: Mapping[str, str]) -> str:
    return next((new + name[len(old) :] for old, new in names.items() if name.startswith(old)), "")


def _assembled(weights: Weights, activation: str) -> CLIPModel:
    """The model of a state dict with OpenAI's names, in the shapes that its weights have."""
    from transformers import CLIPConfig, CLIPModel

    def part(prefix: str, width: int) -> dict[str, Any]:
        blocks = {
            int(one[1]) for one in (re.match(rf"{prefix}(\d+)\.", name) for name in weights) if one
        }
        return {
            "hidden_size": width,
            "intermediate_size": len(weights[f"{prefix}0.mlp.c_fc.weight"]),
            "num_hidden_layers": len(blocks),
            "num_attention_heads": max(1, width // _HEAD),
            "hidden_act": activation,
            "projection_dim": weights["text_projection"].shape[1],
        }

    conv, places = weights["visual.conv1.weight"], weights["visual.positional_embedding"]
    side = round((len(places) - 1) ** 0.5)
    vocabulary, text_width = weights["token_embedding.weight"].shape
    config = CLIPConfig(
        text_config={
            **part("transformer.resblocks.", text_width),
            "vocab_size": vocabulary,
            "max_position_embeddings": len(weights["positional_embedding"]),
            "eos_token_id": _END,
        },
        vision_config={
            **part("visual.transformer.resblocks.", len(conv)),
            "patch_size": conv.shape[-1],
            "image_size": side * conv.shape[-1],
        },
        projection_dim=weights["text_projection"].shape[1],
    )
    with torch.device("meta"):  # drawing random weights would take longer than all else
        model = CLIPModel(config)
        if side * side + 1 != len(places):  # frames that are not square
            embedding = torch.nn.Embedding(*places.shape)
            model.vision_model.embeddings.position_embedding = embedding
    model.load_state_dict(_of_transformers(weights), strict=True, assign=True)
    for tower in (model.vision_model, model.text_model):  # which no checkpoint has
        numbers = torch.arange(tower.embeddings.position_embedding.num_embeddings)
        tower.embeddings.position_ids = numbers.expand((1, -1))
    return model


def _of_transformers(weights: Weights) -> Weights:
    """The same weights by the names of transformers; what it has no name for is left out."""
    renamed: Weights = {}
    for name, tensor in weights.items():
        new = _renamed(name, _OF_OPENAI)
        if block := re.fullmatch(r"(.*\.layers\.\d+\.)(.+)", new):
            first, rest = block.groups()
            if rest.startswith("attn.in_proj_"):
                kind = rest.removeprefix("attn.in_proj_")
                for one, third in zip("qkv", tensor.chunk(3), strict=True):
                    renamed[f"{first}self_attn.{one}_proj.{kind}"] = third
            else:
                renamed[first + _renamed(rest, _OF_BLOCK)] = tensor
        elif new:
            renamed[new] = tensor.T.contiguous() if new.endswith("_projection.weight") else tensor
    return renamed


def _pooled(frames: torch.Tensor, weights: Weights) -> torch.Tensor:
    """MineCLIP's temporal transformer over the embeddings of a clip's frames: [width]."""
    functional = torch.nn.functional
    length, width = frames.shape

    def norm(values: torch.Tensor, name: str) -> torch.Tensor:
        weight, bias = weights[f"{name}.weight"], weights[f"{name}.bias"]
        return functional.layer_norm(values, (width,), weight, bias)

    hidden = frames + weights["pos_emb.emb.weight"][:length] * width**-0.5
    layers = len({name.split(".")[2] for name in weights if name.startswith("attn_layers.layers.")})
    for layer in range(0, layers, 2):
        attention, feed = (f"attn_layers.layers.{one}" for one in (layer, layer + 1))
        values = norm(hidden, f"{attention}.0.0")
        query, key, value = (
            functional.linear(values, weights[f"{attention}.1.to_{one}.weight"])
            .view(length, -1, _HEAD)
            .transpose(0, 1)
            for one in "qkv"
        )
        heard = functional.scaled_dot_product_attention(query, key, value)
        heard = heard.transpose(0, 1).reshape(length, -1)
        hidden = hidden + functional.linear(heard, weights[f"{attention}.1.to_out.weight"])
        inner = functional.linear(
            norm(hidden, f"{feed}.0.0"),
            weights[f"{feed}.1.net.0.proj.weight"],
            weights[f"{feed}.1.net.0.proj.bias"],
        )
        values, gate = inner.chunk(2, dim=-1)
        hidden = hidden + functional.linear(
            values * functional.silu(gate),
            weights[f"{feed}.1.net.3.weight"],
            weights[f"{feed}.1.net.3.bias"],
        )
    return norm(hidden, "norm").mean(0)


def _adapted(clip: torch.Tensor, weights: Weights) -> torch.Tensor:
    """MineCLIP's adapter: the clip's embedding mixed with what a small network makes of it."""
    if "residual_weight" not in weights:
        return clip
    layers = sorted(int(name.split(".")[1]) for name in weights if name.endswith(".weight"))
    made = clip
    for layer in layers:
        made = torch.relu(made) if layer != layers[0] else made
        named = (weights[f"adapter.{layer}.{what}"] for what in ("weight", "bias"))
        made = torch.nn.functional.linear(made, *named)
    share = torch.sigmoid(weights["residual_weight"])
    return share * clip + (1 - share) * made
