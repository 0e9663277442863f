"""The tiny toxicity model of the sandbox: written down in a moment, loaded like the published one.

Same architecture and file layout as Detoxify's `original` (BERT for sequence classification, six
classes, a checkpoint that names bert-base-uncased), 192 wide and two layers deep. Nothing of it
is trained: its weights say its word lists (kb/sandbox/toxicity_weights.py), the same bytes on
every machine. It tells the insults of its lists (kb/sandbox/toxicity_words.py) from plain text
and is good for nothing else: what it scored is marked, and `kb release publish` refuses it.
"""

from __future__ import annotations

import contextlib
import fcntl
import hashlib
import json
from collections.abc import Iterator
from pathlib import Path

from kb.annotate.checkpoint import need_extra, sha256_of
from kb.core.cache import cache_root, making
from kb.sandbox import checkpoint_file, toxicity_weights, toxicity_words
from kb.store.reading import SANDBOX_MODEL

_MADE_OF = (Path(__file__), *(Path(module.__file__ or "") for module in (
    checkpoint_file, toxicity_weights, toxicity_words)))  # fmt: skip


def settings() -> dict[str, str]:
    """The setting that points the software at the tiny model; writes it when there is none yet."""
    return {"KB_TOXICITY_MODEL": str(tiny_checkpoint())}


def tiny_checkpoint(folder: Path | None = None) -> Path:
    """The checkpoint file, with config, vocabulary and `.sha256` beside it.

    Kept in the user's cache; a second call only finds it. Raises MissingExtra.
    """
    made_of = hashlib.sha256(b"".join(path.read_bytes() for path in _MADE_OF)).hexdigest()[:12]
    place = (folder or cache_root() / "models") / f"{SANDBOX_MODEL}-{made_of}"
    checkpoint = place / f"{SANDBOX_MODEL}.ckpt"
    if not checkpoint.is_file():
        need_extra()
        with _alone(place):
            if not checkpoint.is_file():
                with making(place, checkpoint.is_file) as fresh:
                    _write(fresh)
    return checkpoint


@contextlib.contextmanager
def _alone(place: Path) -> Iterator[None]:
    """Two processes that find no model make one, not two into the same folder."""
    place.parent.mkdir(parents=True, exist_ok=True)
    with place.with_suffix(".lock").open("w") as file:
        fcntl.flock(file, fcntl.LOCK_EX)
        yield


def _write(folder: Path) -> None:
    vocabulary = toxicity_weights.vocabulary()
    config = {
        "architectures": ["BertForMaskedLM"],
        "model_type": "bert",
        "vocab_size": len(vocabulary),
        "hidden_size": toxicity_weights.HIDDEN,
        "num_hidden_layers": toxicity_weights.LAYERS,
        "num_attention_heads": toxicity_weights.HEADS,
        "intermediate_size": toxicity_weights.NEURONS,
        "max_position_embeddings": toxicity_weights.WINDOW,
        "layer_norm_eps": toxicity_weights.EPSILON,
        "hidden_dropout_prob": 0.0,
        "attention_probs_dropout_prob": 0.0,
    }
    arguments = {
        "model_type": "bert-base-uncased",
        "model_name": "BertForSequenceClassification",
        "tokenizer_name": "BertTokenizer",
        "num_classes": len(toxicity_weights.CLASSES),
    }
    said = {
        "lorecrawl_sandbox": True,
        "arch": {"type": "BERT", "args": arguments},
        "dataset": {"args": {"classes": list(toxicity_weights.CLASSES)}},
    }
    (folder / "config.json").write_text(json.dumps(config, indent=1), encoding="utf-8")
    (folder / "vocab.txt").write_text("\n".join(vocabulary) + "\n", encoding="utf-8")
    (folder / "tokenizer_config.json").write_text(
        '{"do_lower_case": true, "model_max_length": 512}', encoding="utf-8"
    )
    path = folder / f"{SANDBOX_MODEL}.ckpt"
    checkpoint_file.write_checkpoint(path, said, toxicity_weights.weights())
    (folder / f"{path.name}.sha256").write_text(
        f"{sha256_of(path)}  {path.name}\n", encoding="utf-8"
    )
