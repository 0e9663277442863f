"""A checkpoint as an ONNX graph, made once and kept in the user's cache.

ONNX Runtime computes the same numbers as torch without importing torch, which takes longer than
scoring a small crawl. A fresh graph must agree with Detoxify's own `predict` on probe texts, or it
is thrown away.
"""

from __future__ import annotations

import hashlib
import importlib.metadata
import json
import tempfile
import warnings
from pathlib import Path
from typing import Any

from kb.annotate.checkpoint import Checkpoint, sha256_of
from kb.annotate.detoxify_model import load_detoxify
from kb.annotate.graph import Compiled, graph_runner
from kb.annotate.model_files import tokenizer_files
from kb.annotate.runner import Meta
from kb.core.cache import cache_root, making

FORMAT = 6  # raise it when the folder's files change meaning
TOLERANCE = 1e-4
PROBES = (
    "hello",
    "How to build a house in Minecraft",
    "you are a stupid idiot, shut up!",
    "1 2 3 … ünïcode 方块",
    "a longer text about redstone, pistons and hoppers; " * 4,
)


def place(checkpoint: Checkpoint) -> Path:
    """Where the graph of exactly this checkpoint, configuration and torch is kept."""
    parts = [
        str(FORMAT),
        checkpoint.sha256,
        *(_version(name) for name in ("torch", "transformers", "detoxify")),
    ]
    parts += [
        sha256_of(path)
        for path in [checkpoint.folder / "config.json", *tokenizer_files(checkpoint.folder)]
    ]
    return cache_root() / "compiled" / hashlib.sha256("\n".join(parts).encode()).hexdigest()[:24]


def find_compiled(checkpoint: Checkpoint) -> Compiled | None:
    """The graph that was made before, if it is whole."""
    folder = place(checkpoint)
    try:
        meta = json.loads((folder / "meta.json").read_text(encoding="utf-8"))
        whole = all(sha256_of(folder / name) == digest for name, digest in meta["files"].items())
    except (OSError, ValueError, KeyError):
        return None
    return Compiled(folder) if whole else None


def make_compiled(checkpoint: Checkpoint) -> Compiled | None:
    """Write the graph; None when it doesn't agree with Detoxify, or can't be written."""
    detoxify = load_detoxify(checkpoint)
    folder = place(checkpoint)
    try:
        with making(folder, lambda: find_compiled(checkpoint) is not None) as fresh:
            _export(detoxify, fresh)
            if not _agrees(detoxify, Compiled(fresh)):
                raise _Differs
    except _Differs:
        return None
    except OSError:  # no cache to write to: make it for this run only
        fresh = Path(tempfile.mkdtemp(prefix="kb-compiled-"))
        _export(detoxify, fresh)
        return Compiled(fresh) if _agrees(detoxify, Compiled(fresh)) else None
    return Compiled(folder)


class _Differs(Exception):
    pass


def _export(detoxify: Any, folder: Path) -> None:
    import torch

    ids = torch.ones((2, 7), dtype=torch.long)
    mask = torch.ones((2, 7), dtype=torch.long)
    mask[1, 5:] = 0
    axes = {0: "windows", 1: "tokens"}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        # The exporter by tracing: the newer one needs onnxscript and gives the same graph for BERT.
        torch.onnx.export(
            detoxify.model,
            (ids, mask),
            str(folder / "model.onnx"),
            dynamo=False,
            opset_version=17,
            input_names=["input_ids", "attention_mask"],
            output_names=["logits"],
            dynamic_axes={"input_ids": axes, "attention_mask": axes, "logits": {0: "windows"}},
        )
    detoxify.tokenizer.backend_tokenizer.save(str(folder / "tokenizer.json"))
    meta = Meta.of(detoxify)
    files = {path.name: sha256_of(path) for path in sorted(folder.iterdir())}
    text = json.dumps(
        {
            "classes": meta.classes,
            "prefix": meta.prefix,
            "suffix": meta.suffix,
            "pad": meta.pad,
            "window": meta.window,
            "files": files,
        }
    )
    (folder / "meta.json").write_text(text, encoding="utf-8")


def _agrees(detoxify: Any, compiled: Compiled) -> bool:
    runner = graph_runner(compiled, threads=1)
    own = runner.score(list(PROBES))
    for text, row in zip(PROBES, own, strict=True):
        theirs = detoxify.predict(text)
        if any(
            abs(theirs[name] - score) > TOLERANCE
            for name, score in zip(runner.meta.classes, row, strict=True)
        ):
            return False
    return True


def _version(name: str) -> str:
    try:
        return importlib.metadata.version(name)
    except importlib.metadata.PackageNotFoundError:
        return ""
