"""Small Detoxify-shaped checkpoints with random weights,
of each architecture that Detoxify publishes.
"""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from kb.core.config.settings import load_settings
from kb.store.checkpoint import Checkpoint, find_checkpoint, sha256_of

ORIGINAL = ("toxic", "severe_toxic", "obscene", "threat", "insult", "identity_hate")
SENTENCE = (
    "you are a stupid idiot shut up how to build a house in minecraft with redstone pistons"
    " and hoppers hello there creeper"
)
WORDS = SENTENCE.split()
_SIZES = {
    "hidden_size": 24,
    "num_hidden_layers": 2,
    "num_attention_heads": 3,
    "intermediate_size": 32,
    "initializer_range": 0.4,
}
_CLASSES = {"bert": "Bert", "roberta": "Roberta", "albert": "Albert"}
_MARKS = {
    "roberta": ("<s>", "<pad>", "</s>", "<unk>", "<mask>"),
    "albert": ("<pad>", "<unk>", "[CLS]", "[SEP]", "[MASK]"),
}


def make_checkpoint(
    folder: Path,
    kind: str = "bert",
    classes: Sequence[str] = ORIGINAL,
    outputs: int = 6,
    change: Any = None,
) -> Path:
    """A checkpoint file "mine.ckpt" of `outputs` outputs, with its `.sha256`, configuration and
    tokenizer beside it.

    `change` gets what is written, before it is written.
    """
    import torch
    import transformers

    folder.mkdir(parents=True, exist_ok=True)
    names = {"bert": _wordpiece, "roberta": _bytes, "albert": _unigram}[kind](folder)
    positions = 514 if kind == "roberta" else 512
    more = {
        "roberta": {"pad_token_id": 1, "bos_token_id": 0, "eos_token_id": 2, "type_vocab_size": 1},
        "albert": {"embedding_size": 8},
    }
    torch.manual_seed(7)
    config = getattr(transformers, f"{_CLASSES[kind]}Config")(
        vocab_size=names,
        max_position_embeddings=positions,
        num_labels=outputs,
        **_SIZES,
        **more.get(kind, {}),
    )
    model = getattr(transformers, f"{_CLASSES[kind]}ForSequenceClassification")(config)
    with torch.no_grad():
        for name, weight in model.named_parameters():
            if (
                "classifier" in name
            ):  # else every text has nearly the same score, and agreement means little
                weight.mul_(3.0)
    name = _CLASSES[kind]
    arguments = {
        "model_type": f"{kind}-base",
        "model_name": f"{name}ForSequenceClassification",
        "tokenizer_name": f"{name}Tokenizer",
        "num_classes": outputs,
    }
    held = {
        "config": {
            "arch": {"type": kind, "args": arguments},
            "dataset": {"args": {"classes": list(classes)}},
        },
        "state_dict": {name: value.clone() for name, value in model.state_dict().items()},
    }
    if change:
        change(held)
    path = folder / "mine.ckpt"
    torch.save(held, path)
    path.with_name("mine.ckpt.sha256").write_text(sha256_of(path))
    written = {
        key: value
        for key, value in config.to_dict().items()
        if key not in ("num_labels", "id2label", "label2id")
    }
    (folder / "config.json").write_text(json.dumps(written))
    return path


def checkpoint_of(path: Path) -> Checkpoint:
    """The checkpoint as the software finds it."""
    return find_checkpoint(load_settings(dotenv=False, kb_toxicity_model=str(path)))


def _wordpiece(folder: Path) -> int:
    names = [
        "[PAD]",
        "[UNK]",
        "[CLS]",
        "[SEP]",
        "[MASK]",
        *sorted(set("".join(WORDS))),
        *sorted(set(WORDS) - set("a")),
    ]
    (folder / "vocab.txt").write_text("\n".join(names) + "\n")
    (folder / "tokenizer_config.json").write_text(
        '{"do_lower_case": true, "model_max_length": 512}'
    )
    return len(names)


def _bytes(folder: Path) -> int:
    from tokenizers import Tokenizer, decoders, models, pre_tokenizers, processors, trainers

    made = Tokenizer(models.BPE())
    made.pre_tokenizer, made.decoder = (
        pre_tokenizers.ByteLevel(add_prefix_space=False),
        decoders.ByteLevel(),
    )
    letters = pre_tokenizers.ByteLevel.alphabet()
    made.train_from_iterator(
        [" ".join(WORDS)] * 9,
        trainers.BpeTrainer(
            vocab_size=330, special_tokens=[*_MARKS["roberta"]], initial_alphabet=letters
        ),
    )
    made.post_processor = processors.RobertaProcessing(("</s>", 2), ("<s>", 0))
    made.model.save(str(folder))
    made.save(str(folder / "tokenizer.json"))
    (folder / "tokenizer_config.json").write_text('{"model_max_length": 512}')
    return made.get_vocab_size()


def _unigram(folder: Path) -> int:
    from tokenizers import Tokenizer, decoders, models, pre_tokenizers, processors, trainers

    made = Tokenizer(models.Unigram())
    made.pre_tokenizer, made.decoder = pre_tokenizers.Metaspace(), decoders.Metaspace()
    made.train_from_iterator(
        [" ".join(WORDS)] * 9,
        trainers.UnigramTrainer(
            vocab_size=80, special_tokens=[*_MARKS["albert"]], unk_token="<unk>"
        ),
    )
    made.post_processor = processors.TemplateProcessing(
        single="[CLS] $A [SEP]", special_tokens=[("[CLS]", 2), ("[SEP]", 3)]
    )
    made.save(str(folder / "tokenizer.json"))
    return made.get_vocab_size()
