"""The sandbox's model, written down:
the same bytes everywhere, and every phrase of its lists told.
"""

from __future__ import annotations

import subprocess
import sys

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from kb.annotate import backends, rounding
from kb.annotate.checkpoint import sha256_of
from kb.core import clock
from kb.sandbox import toxicity_weights as tiny_weights
from kb.sandbox import toxicity_words as words
from kb.sandbox.toxicity import tiny_checkpoint
from kb.sandbox.world import World
from tests.annotate.demo_texts import demo_texts, kinds_in
from tests.annotate.least import LEAST

# Another digest is another model: scores that are kept are then scored again.
SHA256 = "58289b191883b1eb4fd5d311d84ce50408c40ab22ccdc7bc9fdb9892d42ac480"
KIND = {"obscene": 2, "threat": 3, "insult": 4, "identity": 5}  # its place among the classes


@pytest.fixture(scope="module", params=["open_runner", "torch_runner"])
def runner(request, checkpoint):
    return getattr(backends, request.param)(checkpoint, "fp32", "cpu", 1)


@pytest.fixture(scope="module")
def chosen(checkpoint):
    return backends.open_runner(checkpoint)


def check(runner, texts):
    """Each text has a wide margin, and is told by the kinds that stand in it."""
    for text, row in zip(texts, runner.score(texts), strict=True):
        there = kinds_in(text)
        assert row[0] >= 0.8 if there else max(row) <= 0.2, (text, row)
        for kind, place in KIND.items():
            assert row[place] >= 0.8 if kind in there else row[place] <= 0.2, (kind, text, row)
        severe = {"obscene", "threat"} <= there
        assert row[1] >= 0.8 if severe else row[1] <= 0.2, (text, row)


def said(count):
    """Things that are said and written in the sandbox's world, in lower case."""
    speech, rng = World().domain.speech, clock.rng("examples of speech")
    kinds = ("title", "about", "say", "step", "post", "post_body", "comment", "reply")
    return [speech.line(rng.choice(kinds), rng, speech.cast(rng)).lower() for _ in range(count)]


def test_every_phrase_of_the_lists_and_every_plain_one(runner):
    phrases = [phrase for held in tiny_weights.KINDS.values() for phrase in held]
    assert len(phrases) > 70
    check(runner, phrases)
    plain = [*words.PLAIN, *words.HARMLESS, *said(400)]
    assert not any(kinds_in(text) for text in plain)
    check(runner, plain)


def test_words_that_only_begin_like_an_insult_are_plain(runner):
    check(
        runner, ["assemble the classic assassin", "dickens scumbles", "you are a jok", "shut upon"]
    )


def test_one_phrase_among_512_tokens_wherever_it_stands(chosen):
    texts = []
    for number, (_, phrase) in enumerate(tiny_weights.phrases()):
        room = 510 - len(phrase)
        at = (0, room, number * 31 % room)[number % 3]
        texts.append(" ".join([*["stone"] * at, *phrase, *["stone"] * (room - at)]))
    check(chosen, [" ".join(["stone"] * 510), *texts])


def test_words_of_a_phrase_that_are_not_in_a_row_are_plain(chosen):
    texts = [" stone ".join(phrase) for _, phrase in tiny_weights.phrases() if len(phrase) > 1] + [
        " ".join(phrase[::-1]) for _, phrase in tiny_weights.phrases() if len(phrase) > 1
    ]
    check(chosen, texts)


_PHRASES = [phrase for held in tiny_weights.KINDS.values() for phrase in held]
_SAID = st.one_of(
    st.sampled_from([*words.PLAIN, *words.HARMLESS]),
    st.sampled_from([word for phrase in _PHRASES for word in phrase.split()]),
    st.text("abcdefghijklmnopqrstuvwxyzABCÄßéи方🎮0123456789", min_size=1, max_size=8),
    st.sampled_from([".", ",", "!", "?", "'", '"', "#", "/", "(", "..."]),
)


@settings(max_examples=25, deadline=None)
@given(st.lists(st.lists(_SAID, max_size=40).map(" ".join), min_size=1, max_size=8), st.data())
def test_random_texts_are_told_as_the_word_lists_tell_them(chosen, texts, data):
    phrase = data.draw(st.sampled_from(_PHRASES))
    check(chosen, [*texts, *(f"{text} {phrase.upper()} {text}" for text in texts)])


def test_every_text_of_the_demo_is_told_with_a_wide_margin(runner):
    texts = demo_texts()
    assert len(texts) > 1000
    assert sum(bool(kinds_in(text)) for text in texts) > 4
    check(runner, texts)


def test_it_is_the_same_bytes_everywhere_and_at_once(tmp_path):
    made = tiny_checkpoint(tmp_path)
    assert sha256_of(made) == SHA256
    code = (
        "import sys\nfrom pathlib import Path\n"
        "from kb.sandbox.toxicity import tiny_checkpoint\n"
        f"print(tiny_checkpoint(Path({str(tmp_path / 'least')!r})))\n"
        "sys.exit(bool({'torch', 'transformers'} & set(sys.modules)))\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], env=LEAST, capture_output=True, text=True, check=True
    )
    assert sha256_of(tmp_path / "least" / made.parent.name / made.name) == SHA256, done.stdout


def test_its_scores_are_far_from_the_middle_between_two_rounded_ones():
    for logits in tiny_weights.LOGITS.values():
        assert not len(rounding.undecided([[logit] for logit in logits])), logits


def test_torchs_own_writer_and_reader_agree_with_the_file(tiny, tmp_path):
    import torch
    from transformers import BertConfig, BertForSequenceClassification

    held = torch.load(tiny, weights_only=True)
    torch.save(held, tmp_path / "again.ckpt")
    again = torch.load(tmp_path / "again.ckpt", weights_only=True)
    assert again["config"] == held["config"]
    assert held["config"]["arch"]["args"]["model_type"] == "bert-base-uncased"
    config = BertConfig.from_pretrained(tiny.parent, num_labels=6)
    model = BertForSequenceClassification(config)
    missing, unexpected = model.load_state_dict(held["state_dict"], strict=False)
    assert not missing
    assert not unexpected
    assert all(torch.equal(again["state_dict"][name], value)
               for name, value in held["state_dict"].items())  # fmt: skip
