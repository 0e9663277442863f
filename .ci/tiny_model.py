"""Make kb/sandbox/data/toxicity/model.tar.zst, the toxicity model of the sandbox, from words.toml.

    .venv/bin/python .ci/tiny_model.py

Same architecture and file layout as Detoxify's `original` (BERT for sequence classification, six
classes, a checkpoint that names bert-base-uncased), 192 wide and two layers deep. Nothing of it is
trained.

A BERT whose numbers are features with names (`PLACES`). Every token's features have one sum and
one sum of squares, whatever the text is, so that each LayerNorm divides by a known number and its
own weight and bias undo that: what comes out of it is what went in.

    embeddings  the word's code (±1, 16 places; words of no phrase share one), whether it goes on
                from the piece before it, and its position as remainders by four moduli
    layer 1     six heads copy the codes of the six words before, one whether the next piece goes
                on; a neuron for each phrase of the lists is on where all of its words stand in a
                row
    layer 2     a head for each kind of phrase looks for it in the whole text
    pooler      any kind: toxic; obscene and threat: severe

Everything that decides is saturated (softmax of differences of 30, tanh of 10), so that the scores
are the same numbers on every processor. Source of the parts: https://arxiv.org/abs/1810.04805
"""

from __future__ import annotations

import io
import itertools
import json
import math
import tarfile
import tomllib
from pathlib import Path

import numpy as np
import torch
import zstandard

from kb.store.tables.reading import SANDBOX_MODEL

DATA = Path(__file__).resolve().parents[1] / "kb" / "sandbox" / "data" / "toxicity"
WORDS = tomllib.loads((DATA / "words.toml").read_text(encoding="utf-8"))
KINDS: dict[str, list[str]] = WORDS["kinds"]

WINDOW = 512
HIDDEN, LAYERS, HEADS, EPSILON = 192, 2, 8, 1e-12
HEAD = HIDDEN // HEADS
# Each class: the logit of a text without it, and of one with it. Their scores are far from the
# middle between two rounded ones.
LOGITS = {
    "toxic": (-3.9, 3.7),
    "severe_toxic": (-5.2, 1.9),
    "obscene": (-4.3, 3.1),
    "threat": (-4.65, 2.8),
    "insult": (-4.1, 3.4),
    "identity_hate": (-4.8, 2.6),
}
CLASSES = tuple(LOGITS)
BEFORE = 6  # words before a word that a phrase may have
CODE, APART = 16, 8  # places of a code; how far its product with another code is below that
MODULI = (3, 5, 7, 8)  # their product is beyond 512 + 6: no two positions have all remainders equal
SHARP = 60.0  # of the heads that look for a position: what one more equal remainder is worth
FOUND = 30.0  # of the heads that look for a phrase
STEEP = 20.0

_names = [
    *(f"code {n}" for n in range(CODE)),
    "whole",
    "goes on",
    *(f"position {modulus}:{rest}" for modulus in MODULI for rest in range(modulus)),
    *(f"no position {modulus}" for modulus in MODULI),
    *(f"before {back} code {n}" for back in range(1, BEFORE + 1) for n in range(CODE)),
    "next whole",
    "next goes on",
    *(f"{kind} {state} {where}" for where in ("here", "anywhere") for kind in KINDS
      for state in ("off", "on")),
]  # fmt: skip
PLACES = {name: place for place, name in enumerate(_names)}
NEURONS = 128


def phrases() -> list[tuple[str, tuple[str, ...]]]:
    """(kind, words) of each phrase; one that ends with another of its kind needs no neuron."""
    every = [(kind, tuple(phrase.split())) for kind, held in KINDS.items() for phrase in held]
    return [
        (kind, phrase)
        for kind, phrase in every
        if not any((kind, phrase[start:]) in every for start in range(1, len(phrase)))
    ]


def vocabulary() -> list[str]:
    """WordPiece vocabulary: marks, characters, and every word of the lists whole."""
    characters = [chr(code) for code in range(33, 127) if not chr(code).isupper()]
    listed = " ".join([*itertools.chain(*KINDS.values()), *WORDS["harmless"]]).split()
    whole = sorted({*WORDS["plain"], *listed} - set(characters))
    endings = ["##s", "##ed", "##ing", "##er", "##ly", "##y"]
    pieces = [
        "##" + character
        for character in characters
        if character.isalnum() and "##" + character not in endings
    ]
    return ["[PAD]", "[UNK]", "[CLS]", "[SEP]", "[MASK]", *characters, *pieces, *endings, *whole]


def weights() -> dict[str, np.ndarray]:
    """The state of a transformers `BertForSequenceClassification`, float32, by name."""
    vocab = vocabulary()
    state: dict[str, np.ndarray] = {}
    state["bert.embeddings.word_embeddings.weight"] = _word_rows(vocab)
    state["bert.embeddings.position_embeddings.weight"] = _position_rows()
    kinds = np.zeros((2, HIDDEN))
    for kind, where in itertools.product(KINDS, ("here", "anywhere")):
        kinds[:, PLACES[f"{kind} off {where}"]] = 1
    state["bert.embeddings.token_type_embeddings.weight"] = kinds
    total = 1 + len(MODULI) + 2 * len(KINDS)  # the places of 1; codes add up to nothing
    squares = total + CODE
    state |= _norm("bert.embeddings.LayerNorm", total, squares)
    # Layer 1 writes the next piece's mark (1) and six codes into places that were empty.
    total, squares = total + 1, squares + 1 + BEFORE * CODE
    state |= _neighbours("bert.encoder.layer.0", total, squares)
    state |= _phrase_neurons("bert.encoder.layer.0", total, squares)
    state |= _anywhere("bert.encoder.layer.1", total, squares)
    state |= _classifier()
    return {name: np.ascontiguousarray(value, np.float32) for name, value in state.items()}


def _codes() -> dict[str, np.ndarray]:
    """A code for each word of a phrase, "" for all other words: balanced, far from each other."""
    names = ["", *sorted({word for _, phrase in phrases() for word in phrase})]
    codes: list[np.ndarray] = []
    for ups in itertools.combinations(range(CODE), CODE // 2):
        code = np.full(CODE, -1.0)
        code[list(ups)] = 1
        if all(code @ other <= CODE - APART for other in codes):
            codes.append(code)
        if len(codes) == len(names):
            return dict(zip(names, codes, strict=True))
    raise ValueError(f"{len(names)} words of phrases, {len(codes)} codes")


def _word_rows(vocab: list[str]) -> np.ndarray:
    codes = _codes()
    rows = np.zeros((len(vocab), HIDDEN))
    for number, name in enumerate(vocab):
        rows[number, :CODE] = codes.get(name, codes[""])
        rows[number, PLACES["goes on" if name.startswith("##") else "whole"]] = 1
    return rows


def _position_rows() -> np.ndarray:
    """Remainders of 1 … 511; the first mark has no position, which the heads can see."""
    rows = np.zeros((WINDOW, HIDDEN))
    for modulus in MODULI:
        rows[0, PLACES[f"no position {modulus}"]] = 1
        for position in range(1, WINDOW):
            rows[position, PLACES[f"position {modulus}:{position % modulus}"]] = 1
    return rows


def _norm(name: str, total: float, squares: float) -> dict[str, np.ndarray]:
    """A LayerNorm that gives back what it gets, of features with this sum and sum of squares."""
    mean = total / HIDDEN
    deviation = math.sqrt(squares / HIDDEN - mean * mean + EPSILON)
    return {f"{name}.weight": np.full(HIDDEN, deviation), f"{name}.bias": np.full(HIDDEN, mean)}


def _empty_layer(name: str) -> dict[str, np.ndarray]:
    shapes = {
        "attention.self.query": (HIDDEN, HIDDEN),
        "attention.self.key": (HIDDEN, HIDDEN),
        "attention.self.value": (HIDDEN, HIDDEN),
        "attention.output.dense": (HIDDEN, HIDDEN),
        "intermediate.dense": (NEURONS, HIDDEN),
        "output.dense": (HIDDEN, NEURONS),
    }
    layer = {f"{name}.{part}.weight": np.zeros(shape) for part, shape in shapes.items()}
    return layer | {f"{name}.{part}.bias": np.zeros(shape[0]) for part, shape in shapes.items()}


def _neighbours(name: str, total: float, squares: float) -> dict[str, np.ndarray]:
    """Head n copies the code n + 1 words back; the seventh whether the next piece goes on.

    A head's product is `SHARP` for each remainder that fits; the first mark, which has none, gets
    half a remainder less than all: it is taken where a text has nothing so far back.
    """
    layer = _empty_layer(name)
    query, key = (layer[f"{name}.attention.self.{part}.weight"] for part in ("query", "key"))
    value = layer[f"{name}.attention.self.value.weight"]
    out = layer[f"{name}.attention.output.dense.weight"]
    scale = math.sqrt(HEAD)  # BERT divides by it
    for head, back in enumerate((*range(1, BEFORE + 1), -1)):
        row = head * HEAD
        for modulus in MODULI:
            for rest in range(modulus):
                wanted = (rest - back) % modulus
                query[row + wanted, PLACES[f"position {modulus}:{rest}"]] = SHARP * scale
                key[row + wanted, PLACES[f"position {modulus}:{wanted}"]] = 1
            row += modulus
        layer[f"{name}.attention.self.query.bias"][row] = SHARP * scale
        key[row, PLACES[f"no position {MODULI[0]}"]] = len(MODULI) - 0.5
        row = head * HEAD
        if back < 0:
            pairs = [("whole", "next whole"), ("goes on", "next goes on")]
        else:
            pairs = [(f"code {n}", f"before {back} code {n}") for n in range(CODE)]
        for n, (source, target) in enumerate(pairs):
            value[row + n, PLACES[source]] = 1
            out[PLACES[target], row + n] = 1
    return layer | _norm(f"{name}.attention.output.LayerNorm", total, squares)


def _phrase_neurons(name: str, total: float, squares: float) -> dict[str, np.ndarray]:
    """A neuron is 9 where its phrase ends and nothing elsewhere: gelu(-9) is 1e-18."""
    layer = {
        f"{name}.{part}": np.zeros(shape)
        for part, shape in (
            ("intermediate.dense.weight", (NEURONS, HIDDEN)),
            ("intermediate.dense.bias", (NEURONS,)),
            ("output.dense.weight", (HIDDEN, NEURONS)),
            ("output.dense.bias", (HIDDEN,)),
        )
    }
    codes, margin, high = _codes(), APART / 2, 9.0
    for neuron, (kind, phrase) in enumerate(phrases()):
        row = layer[f"{name}.intermediate.dense.weight"][neuron]
        for back, word in enumerate(reversed(phrase)):
            start = PLACES[f"before {back} code 0" if back else "code 0"]
            row[start : start + CODE] = codes[word] * high / margin
        # "assemble" begins with a word of the lists. As much as needed: 8-bit weights share one
        # scale.
        row[PLACES["next goes on"]] = -2 * high
        layer[f"{name}.intermediate.dense.bias"][neuron] = high - len(phrase) * CODE * high / margin
        for state, sign in (("on", 1.0), ("off", -1.0)):
            layer[f"{name}.output.dense.weight"][PLACES[f"{kind} {state} here"], neuron] = (
                sign / high
            )
    return layer | _norm(f"{name}.output.LayerNorm", total, squares)


def _anywhere(name: str, total: float, squares: float) -> dict[str, np.ndarray]:
    """A head for each kind: what it finds anywhere in the text, every token knows."""
    layer = _empty_layer(name)
    for head, kind in enumerate(KINDS):
        row = head * HEAD
        layer[f"{name}.attention.self.query.bias"][row] = FOUND * math.sqrt(HEAD)
        layer[f"{name}.attention.self.key.weight"][row, PLACES[f"{kind} on here"]] = 1
        layer[f"{name}.attention.self.value.weight"][row, PLACES[f"{kind} on here"]] = 1
        out = layer[f"{name}.attention.output.dense.weight"]
        out[PLACES[f"{kind} on anywhere"], row] = 1
        out[PLACES[f"{kind} off anywhere"], row] = -1
    for part in ("attention.output.LayerNorm", "output.LayerNorm"):
        layer |= _norm(f"{name}.{part}", total, squares)
    return layer


def _classifier() -> dict[str, np.ndarray]:
    """A pooled feature of ±1 for each class, made one of its two logits."""
    pooler, bias = np.zeros((HIDDEN, HIDDEN)), np.zeros(HIDDEN)
    kinds = {
        "toxic": (tuple(KINDS), 0.5),
        "severe_toxic": (("obscene", "threat"), 1.5),
        "identity_hate": (("identity",), 0.5),
    }
    for number, name in enumerate(CLASSES):
        needed, least = kinds.get(name, ((name,), 0.5))
        for kind in needed:
            pooler[number, PLACES[f"{kind} on anywhere"]] = STEEP
        bias[number] = -STEEP * least
    logits = np.zeros((len(CLASSES), HIDDEN))
    for number, (plain, told) in enumerate(LOGITS.values()):
        logits[number, number] = (told - plain) / 2
    return {
        "bert.pooler.dense.weight": pooler,
        "bert.pooler.dense.bias": bias,
        "classifier.weight": logits,
        "classifier.bias": np.array([(plain + told) / 2 for plain, told in LOGITS.values()]),
    }


def files() -> dict[str, bytes]:
    """The files of the model's folder, by name."""
    names = vocabulary()
    config = {
        "architectures": ["BertForMaskedLM"],
        "model_type": "bert",
        "vocab_size": len(names),
        "hidden_size": HIDDEN,
        "num_hidden_layers": LAYERS,
        "num_attention_heads": HEADS,
        "intermediate_size": NEURONS,
        "max_position_embeddings": WINDOW,
        "layer_norm_eps": EPSILON,
        "hidden_dropout_prob": 0.0,
        "attention_probs_dropout_prob": 0.0,
    }
    arguments = {
        "model_type": "bert-base-uncased",
        "model_name": "BertForSequenceClassification",
        "tokenizer_name": "BertTokenizer",
        "num_classes": len(CLASSES),
    }
    about = {
        "lorecrawl_sandbox": True,
        "arch": {"type": "BERT", "args": arguments},
        "dataset": {"args": {"classes": list(CLASSES)}},
    }
    state = {name: torch.from_numpy(value) for name, value in weights().items()}
    checkpoint = io.BytesIO()
    torch.save({"config": about, "state_dict": state}, checkpoint)
    return {
        "config.json": json.dumps(config, indent=1).encode(),
        "vocab.txt": ("\n".join(names) + "\n").encode(),
        "tokenizer_config.json": b'{"do_lower_case": true, "model_max_length": 512}',
        f"{SANDBOX_MODEL}.ckpt": checkpoint.getvalue(),
    }


def main() -> None:
    """Write the archive: without times and owners, so that the same files give the same bytes."""
    archive = io.BytesIO()
    with tarfile.open(fileobj=archive, mode="w") as tar:
        for name, data in files().items():
            entry = tarfile.TarInfo(name)
            entry.size = len(data)
            tar.addfile(entry, io.BytesIO(data))
    packed = zstandard.ZstdCompressor(level=19).compress(archive.getvalue())
    (DATA / "model.tar.zst").write_bytes(packed)


if __name__ == "__main__":
    main()
