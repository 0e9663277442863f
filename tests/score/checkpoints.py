"""The same random weights in the formats of CLIP checkpoints, and MineCLIP as its paper describes
it, written down apart from the code under test.
"""

from pathlib import Path

import torch
from torch import nn
from transformers import CLIPConfig, CLIPModel

WIDTH, LAYERS, SIDE, PATCH, VOCABULARY = 128, 2, 64, 16, 49_408
IMAGE, TEXT = "visual.transformer.resblocks", "transformer.resblocks"


def random_clip(vocabulary: int = VOCABULARY, dimensions: int = 64) -> CLIPModel:
    """A small CLIP of transformers with random weights."""
    torch.manual_seed(0)
    part = {
        "hidden_size": WIDTH,
        "intermediate_size": 2 * WIDTH,
        "num_hidden_layers": LAYERS,
        "num_attention_heads": WIDTH // 64,
    }
    text = {**part, "eos_token_id": 49_407, "vocab_size": vocabulary}
    vision = {**part, "image_size": SIDE, "patch_size": PATCH}
    model = CLIPModel(CLIPConfig(text_config=text, vision_config=vision, projection_dim=dimensions))
    for weights in model.parameters():
        weights.data += torch.randn_like(weights) * 0.05
    return model.eval()


def of_openai(model: CLIPModel) -> dict[str, torch.Tensor]:
    """Its weights under the names of OpenAI's CLIP and open_clip."""
    held = model.state_dict()
    made = {
        "logit_scale": held["logit_scale"],
        "visual.class_embedding": held["vision_model.embeddings.class_embedding"],
        "visual.conv1.weight": held["vision_model.embeddings.patch_embedding.weight"],
        "visual.positional_embedding": held["vision_model.embeddings.position_embedding.weight"],
        "visual.proj": held["visual_projection.weight"].T,
        "token_embedding.weight": held["text_model.embeddings.token_embedding.weight"],
        "positional_embedding": held["text_model.embeddings.position_embedding.weight"],
        "text_projection": held["text_projection.weight"].T,
    }
    for what in ("weight", "bias"):
        made[f"visual.ln_pre.{what}"] = held[f"vision_model.pre_layrnorm.{what}"]
        made[f"visual.ln_post.{what}"] = held[f"vision_model.post_layernorm.{what}"]
        made[f"ln_final.{what}"] = held[f"text_model.final_layer_norm.{what}"]
        for tower, theirs in ((IMAGE, "vision_model"), (TEXT, "text_model")):
            for layer in range(LAYERS):
                mine, old = f"{tower}.{layer}", f"{theirs}.encoder.layers.{layer}"
                three = [held[f"{old}.self_attn.{one}_proj.{what}"] for one in "qkv"]
                made[f"{mine}.attn.in_proj_{what}"] = torch.cat(three)
                made[f"{mine}.attn.out_proj.{what}"] = held[f"{old}.self_attn.out_proj.{what}"]
                made[f"{mine}.ln_1.{what}"] = held[f"{old}.layer_norm1.{what}"]
                made[f"{mine}.ln_2.{what}"] = held[f"{old}.layer_norm2.{what}"]
                made[f"{mine}.mlp.c_fc.{what}"] = held[f"{old}.mlp.fc1.{what}"]
                made[f"{mine}.mlp.c_proj.{what}"] = held[f"{old}.mlp.fc2.{what}"]
    return {name: tensor.clone() for name, tensor in made.items()}


class _Block(nn.Module):
    def __init__(self, mask: torch.Tensor | None = None) -> None:
        super().__init__()
        self.attn = nn.MultiheadAttention(WIDTH, WIDTH // 64, batch_first=True)
        self.ln_1, self.ln_2 = nn.LayerNorm(WIDTH), nn.LayerNorm(WIDTH)
        layers = {"c_fc": nn.Linear(WIDTH, 4 * WIDTH), "c_proj": nn.Linear(4 * WIDTH, WIDTH)}
        self.mlp, self._mask = nn.ModuleDict(layers), mask

    def forward(self, values: torch.Tensor) -> torch.Tensor:
        held = self.ln_1(values)
        values = values + self.attn(held, held, held, attn_mask=self._mask)[0]
        inner = self.mlp["c_fc"](self.ln_2(values))
        return values + self.mlp["c_proj"](inner * torch.sigmoid(1.702 * inner))


class _Vision(nn.Module):
    def __init__(self) -> None:
        super().__init__()
        self.conv1 = nn.Conv2d(3, WIDTH, PATCH, PATCH, bias=False)
        self.cls_token = nn.Parameter(torch.randn(WIDTH))
        self.pos_embed = nn.Parameter(torch.randn(10 * 16 + 1, WIDTH) / 10)
        self.ln_pre, self.ln_post = nn.LayerNorm(WIDTH), nn.LayerNorm(WIDTH)
        self.blocks = nn.Sequential(*(_Block() for _ in range(LAYERS)))
        self.projection = nn.Parameter(torch.randn(WIDTH, WIDTH) / 10)

    def forward(self, pixels: torch.Tensor) -> torch.Tensor:
        patches = self.conv1(pixels).flatten(2).transpose(1, 2)
        every = torch.cat([self.cls_token.repeat(len(pixels), 1, 1), patches], 1)
        seen = self.blocks(self.ln_pre(every + self.pos_embed))
        return self.ln_post(seen[:, 0]) @ self.projection


class _Text(nn.Module):
    def __init__(self) -> None:
        super().__init__()
        mask = torch.full((77, 77), float("-inf")).triu(1)
        self.token_embedding = nn.Embedding(VOCABULARY, WIDTH)
        self.pos_embed = nn.Parameter(torch.randn(77, WIDTH) / 10)
        self.blocks = nn.Sequential(*(_Block(mask) for _ in range(LAYERS)))
        self.ln_final = nn.LayerNorm(WIDTH)
        self.projection = nn.Parameter(torch.randn(WIDTH, WIDTH) / 10)

    def forward(self, tokens: torch.Tensor) -> torch.Tensor:
        read = self.ln_final(self.blocks(self.token_embedding(tokens) + self.pos_embed))
        return read[torch.arange(len(read)), tokens.argmax(-1)] @ self.projection


class _Attention(nn.Module):
    def __init__(self) -> None:
        super().__init__()
        for name in ("to_q", "to_k", "to_v"):
            setattr(self, name, nn.Linear(WIDTH, 512, bias=False))
        self.to_out = nn.Linear(512, WIDTH, bias=False)

    def forward(self, values: torch.Tensor) -> torch.Tensor:
        q, k, v = (one(values).unflatten(-1, (8, 64)) for one in (self.to_q, self.to_k, self.to_v))
        weights = (torch.einsum("ihd,jhd->hij", q, k) / 8).softmax(-1)
        return self.to_out(torch.einsum("hij,jhd->ihd", weights, v).flatten(1))


class _Gated(nn.Module):
    def __init__(self) -> None:
        super().__init__()
        first = nn.Module()
        first.proj = nn.Linear(WIDTH, 8 * WIDTH)
        self.net = nn.ModuleList([first, nn.Identity(), nn.Identity(), nn.Linear(4 * WIDTH, WIDTH)])

    def forward(self, values: torch.Tensor) -> torch.Tensor:
        inner, gate = self.net[0].proj(values).chunk(2, dim=-1)
        return self.net[3](inner * gate * torch.sigmoid(gate))


class _Temporal(nn.Module):
    """Two layers of attention and feed-forward over the frames, then their mean."""

    def __init__(self) -> None:
        super().__init__()
        self.pos_emb = nn.ModuleDict({"emb": nn.Embedding(32, WIDTH)})
        layers = [
            nn.ModuleList([nn.ModuleList([nn.LayerNorm(WIDTH)]), kind()])
            for _ in range(2)
            for kind in (_Attention, _Gated)
        ]
        self.attn_layers = nn.ModuleDict({"layers": nn.ModuleList(layers)})
        self.norm = nn.LayerNorm(WIDTH)

    def forward(self, frames: torch.Tensor) -> torch.Tensor:
        values = frames + self.pos_emb["emb"](torch.arange(len(frames))) / WIDTH**0.5
        for (norm,), layer in self.attn_layers["layers"]:
            values = values + layer(norm(values))
        return self.norm(values).mean(0)


class MineClip(nn.Module):
    """MineCLIP with attention, at a small width. The names are those of the published checkpoint,
    in which the parts of CLIP stand three times.
    """

    def __init__(self) -> None:
        super().__init__()
        torch.manual_seed(1)
        self.clip_model = nn.Module()
        self.clip_model.vision_model, self.clip_model.text_model = _Vision(), _Text()
        self.clip_model.logit_scale = nn.Parameter(torch.tensor(2.6))
        self.image_encoder = self.clip_model.vision_model
        self.temporal_encoder = nn.Module()
        self.temporal_encoder.attn = nn.ModuleDict({"model": _Temporal()})
        self.reward_head = nn.Module()
        self.reward_head.clip_model = self.clip_model
        linear = (nn.Linear(WIDTH, WIDTH), nn.ReLU(), nn.Linear(WIDTH, WIDTH))
        self.reward_head.video_adapter = nn.Sequential(*linear)
        self.reward_head.video_residual_weight = nn.Parameter(torch.tensor(0.3))
        for weights in self.parameters():
            weights.data += torch.randn_like(weights) * 0.05
        self.eval()

    def save(self, path: Path) -> Path:
        """As it was published: a state dict below a key, each name below `model.`."""
        weights = {f"model.{name}": tensor for name, tensor in self.state_dict().items()}
        torch.save({"state_dict": weights}, path)
        return path

    def clip(self, frames: torch.Tensor) -> torch.Tensor:
        """The clip's embedding from those of 16 frames, of length 1."""
        pooled = self.temporal_encoder.attn["model"](frames)
        share = torch.sigmoid(self.reward_head.video_residual_weight)
        mixed = share * pooled + (1 - share) * self.reward_head.video_adapter(pooled)
        return nn.functional.normalize(mixed, dim=-1)
