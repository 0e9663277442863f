"""The tiny toxicity model of the sandbox: trained here in seconds, loaded like the published one.

Same architecture and file layout as Detoxify's `original` (BERT for sequence classification, six
classes, a checkpoint that names bert-base-uncased), 64 wide and two layers deep. It tells insults
made of its own word lists (kb/sandbox/toxicity_words.py) from plain text and is good for nothing
else: what it scored is marked, and `kb release publish` refuses it.
"""

from __future__ import annotations

import contextlib
import fcntl
import json
import math
import random
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from kb.annotate.cache import cache_root, making
from kb.annotate.checkpoint import need_extra, sha256_of
from kb.core import clock
from kb.core.errors import FatalError
from kb.sandbox import toxicity_words as words
from kb.store.reading import SANDBOX_MODEL

VERSION = 1  # raise it when words, sizes or training change: cached models of other versions are left alone
CLASSES = ("toxic", "severe_toxic", "obscene", "threat", "insult", "identity_hate")
STEPS, BATCH, SHORT, WINDOW = 400, 32, 32, 512


def settings() -> dict[str, str]:
    """The setting that points the software at the tiny model; trains it when there is none yet."""
    return {"KB_TOXICITY_MODEL": str(tiny_checkpoint())}


def tiny_checkpoint(folder: Path | None = None) -> Path:
    """The checkpoint file, with config, vocabulary and `.sha256` beside it.

    Kept in the user's cache; a second call only finds it. Raises MissingExtra.
    """
    import hashlib

    import_key = hashlib.sha256(
        Path(__file__).read_bytes() + Path(words.__file__).read_bytes()
    ).hexdigest()[:8]
    place = (folder or cache_root() / "models") / f"{SANDBOX_MODEL}-v{VERSION}-{import_key}"
    checkpoint = place / f"{SANDBOX_MODEL}.ckpt"
    if not checkpoint.is_file():
        need_extra()
        with _alone(place):
            if not checkpoint.is_file():
                with making(place, checkpoint.is_file) as fresh:
                    _train(fresh)
    return checkpoint


@contextlib.contextmanager
def _alone(place: Path) -> Iterator[None]:
    """Two processes that find no model make one, not two into the same folder."""
    place.parent.mkdir(parents=True, exist_ok=True)
    with place.with_suffix(".lock").open("w") as file:
        fcntl.flock(file, fcntl.LOCK_EX)
        yield


def vocabulary() -> list[str]:
    """WordPiece vocabulary: marks, characters, and every word of the lists whole."""
    characters = [chr(code) for code in range(33, 127) if not chr(code).isupper()]
    toxic = " ".join(
        [*words.INSULT, *words.OBSCENE, *words.THREAT, *words.IDENTITY, *words.HARMLESS]
    ).split()
    whole = sorted({*words.PLAIN, *toxic} - set(characters))
    endings = ["##s", "##ed", "##ing", "##er", "##ly", "##y"]
    pieces = [
        "##" + character
        for character in characters
        if character.isalnum() and "##" + character not in endings
    ]
    return ["[PAD]", "[UNK]", "[CLS]", "[SEP]", "[MASK]", *characters, *pieces, *endings, *whole]


def example(rng: random.Random, longest: int) -> tuple[str, list[float]]:
    """A text of at most `longest` words, and its six labels."""
    length = max(1, int(math.exp(rng.uniform(0, math.log(longest)))))
    text = [_plain_word(rng) for _ in range(length)]
    if (
        rng.random() < 0.35
    ):  # what the invented world says, so that it is told apart with a wide margin
        text = [rng.choice(words.SAID) for _ in range(rng.randint(1, 3))]
    for _ in range(rng.choice((0, 0, 1, 2))):
        text.insert(rng.randrange(len(text) + 1), rng.choice(words.HARMLESS))
    labels = [0.0] * 6
    if rng.random() < 0.5:
        kinds = rng.choice(
            (
                ("insult",),
                ("insult",),
                ("obscene",),
                ("threat",),
                ("identity",),
                ("insult", "obscene"),
                ("obscene", "threat"),
            )
        )
        for kind in kinds:
            text.insert(rng.randrange(len(text) + 1), rng.choice(getattr(words, kind.upper())))
        if rng.random() < 0.15:
            text = [rng.choice(getattr(words, kind.upper())) for kind in kinds]
        labels = [
            1.0,
            float(kinds == ("obscene", "threat")),
            *(float(kind in kinds) for kind in ("obscene", "threat", "insult", "identity")),
        ]
    return " ".join(text), labels


def _plain_word(rng: random.Random) -> str:
    kind = rng.random()
    if kind < 0.78:
        return rng.choice(words.PLAIN)
    if kind < 0.9:
        return "".join(
            rng.choice("aabcdeefghiijklmnooprstuuvwxyz") for _ in range(rng.randint(2, 9))
        )
    return rng.choice(
        (
            ".",
            ",",
            "!",
            "?",
            ":",
            "-",
            "(",
            ")",
            "'",
            '"',
            "#",
            "/",
            "&",
            ";",
            "<",
            ">",
            str(rng.randint(0, 4000)),
        )
    )


def _train(folder: Path) -> None:
    import torch
    from transformers import BertConfig, BertForSequenceClassification, BertTokenizer

    names = vocabulary()
    config = BertConfig(
        vocab_size=len(names),
        hidden_size=64,
        num_hidden_layers=2,
        num_attention_heads=2,
        intermediate_size=128,
        max_position_embeddings=WINDOW,
        hidden_dropout_prob=0.0,
        attention_probs_dropout_prob=0.0,
        num_labels=6,
        initializer_range=0.1,
        problem_type="multi_label_classification",
    )
    (folder / "config.json").write_text(
        json.dumps(
            {
                "architectures": ["BertForMaskedLM"],
                "model_type": "bert",
                **{
                    key: getattr(config, key)
                    for key in (
                        "vocab_size",
                        "hidden_size",
                        "num_hidden_layers",
                        "num_attention_heads",
                        "intermediate_size",
                        "max_position_embeddings",
                        "hidden_dropout_prob",
                        "attention_probs_dropout_prob",
                    )
                },
            },
            indent=1,
        ),
        encoding="utf-8",
    )
    (folder / "vocab.txt").write_text("\n".join(names) + "\n", encoding="utf-8")
    (folder / "tokenizer_config.json").write_text(
        '{"do_lower_case": true, "model_max_length": 512}', encoding="utf-8"
    )
    tokenizer = BertTokenizer.from_pretrained(folder, local_files_only=True)

    threads = torch.get_num_threads()
    torch.set_num_threads(1)  # sums in one order: the same bytes on every run
    try:
        with torch.random.fork_rng(devices=[]):
            for seed in (2, 0, 1):  # some starts learn little; the first one is known to do well
                torch.manual_seed(seed)
                model = BertForSequenceClassification(config)
                _fit(model, tokenizer)
                if _share_told(model, tokenizer) >= 0.93:
                    break
            else:
                raise FatalError(
                    "the tiny toxicity model learned nothing",
                    hint="remove it from the cache and try again",
                )
    finally:
        torch.set_num_threads(threads)
    arguments = {
        "model_type": "bert-base-uncased",
        "model_name": "BertForSequenceClassification",
        "tokenizer_name": "BertTokenizer",
        "num_classes": len(CLASSES),
    }
    state = {name: value.clone() for name, value in model.state_dict().items()}
    path = folder / f"{SANDBOX_MODEL}.ckpt"
    torch.save(
        {
            "config": {
                "lorebase_sandbox": True,
                "arch": {"type": "BERT", "args": arguments},
                "dataset": {"args": {"classes": list(CLASSES)}},
            },
            "state_dict": state,
        },
        path,
    )
    (folder / f"{SANDBOX_MODEL}.ckpt.sha256").write_text(
        f"{sha256_of(path)}  {path.name}\n", encoding="utf-8"
    )


def _fit(model: Any, tokenizer: Any) -> None:
    """Train until fresh texts are told apart; short texts first, because they teach the words."""
    import torch

    rng = clock.rng("tiny toxicity model", VERSION)
    optimizer = torch.optim.AdamW(model.parameters(), lr=3e-3, weight_decay=0.01)
    for step in range(STEPS):
        model.train()
        long = step > STEPS // 6 and step % 12 == 11  # one insult must be found among 500 tokens
        longest, size = (400, 5) if long else (min(SHORT, 2 + step // 5), BATCH)
        texts, labels = zip(*(example(rng, longest) for _ in range(size)), strict=True)
        tokens = tokenizer(list(texts), return_tensors="pt", padding=True, truncation=True)
        width = tokens["input_ids"].shape[1]
        start = torch.tensor(
            [[rng.randint(0, WINDOW - width) if rng.random() < 0.7 else 0] for _ in range(size)]
        )
        out = model(
            input_ids=tokens["input_ids"],
            attention_mask=tokens["attention_mask"],
            position_ids=start + torch.arange(width),
        )
        loss = torch.nn.functional.binary_cross_entropy_with_logits(
            out.logits, torch.tensor(labels)
        )
        for group in optimizer.param_groups:
            group["lr"] = 3e-3 * min(1.0, step / 20, (STEPS - step) / 40)
        optimizer.zero_grad()
        loss.backward()
        torch.nn.utils.clip_grad_norm_(model.parameters(), 1.0)
        optimizer.step()
    model.eval()


def _share_told(model: Any, tokenizer: Any) -> float:
    """The share of fresh texts, short and long, on whose plainness model and word lists agree."""
    import torch

    rng = clock.rng("tiny toxicity model", VERSION, "check")
    right = total = 0
    for longest, size in ((SHORT, 160), (300, 8)):
        texts, labels = zip(*(example(rng, longest) for _ in range(size)), strict=True)
        tokens = tokenizer(list(texts), return_tensors="pt", padding=True, truncation=True)
        with torch.no_grad():
            scores = torch.sigmoid(
                model(input_ids=tokens["input_ids"], attention_mask=tokens["attention_mask"]).logits
            )
        told = [
            (row.max().item() > 0.5) == (max(wanted) > 0.5)
            for row, wanted in zip(scores, labels, strict=True)
        ]
        right, total = right + sum(told), total + len(told)
    return right / total
