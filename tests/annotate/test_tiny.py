"""The sandbox's model: every phrase of its lists is told, and nothing else is."""

import importlib.util
import io

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from kb.annotate import backends
from kb.core import clock
from kb.sandbox.world import World
from tests.annotate.demo_texts import _WORD, KINDS, WORDS, demo_texts
from tests.conftest import ROOT


def kinds_in(text: str) -> set[str]:
    """The kinds of phrases of the word lists that stand in the text as whole words."""
    said = " " + " ".join(_WORD.findall(text.lower())) + " "
    return {kind for kind, phrases in KINDS.items() if any(f" {one} " in said for one in phrases)}


PHRASES = [phrase for phrases in KINDS.values() for phrase in phrases]
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
    assert len(PHRASES) > 70
    check(runner, PHRASES)
    plain = [*WORDS["plain"], *WORDS["harmless"], *said(400)]
    assert not any(kinds_in(text) for text in plain)
    check(runner, plain)
    assert not runner.exactly, "a score lies on the edge between two rounded ones"


def test_words_that_only_begin_like_an_insult_are_plain(runner):
    check(
        runner, ["assemble the classic assassin", "dickens scumbles", "you are a jok", "shut upon"]
    )


def test_one_phrase_among_512_tokens_wherever_it_stands(chosen):
    texts = []
    for number, phrase in enumerate(map(str.split, PHRASES[::4])):
        room = 510 - len(phrase)
        at = (0, room, number * 31 % room)[number % 3]
        texts.append(" ".join([*["stone"] * at, *phrase, *["stone"] * (room - at)]))
    check(chosen, [" ".join(["stone"] * 510), *texts])


def test_words_of_a_phrase_that_are_not_in_a_row_are_plain(chosen):
    rows = [phrase.split() for phrase in PHRASES if " " in phrase]
    texts = [mixed for row in rows for mixed in (" stone ".join(row), " ".join(row[::-1]))]
    check(chosen, [text for text in texts if not kinds_in(text)])


_SAID = st.one_of(
    st.sampled_from([*WORDS["plain"], *WORDS["harmless"]]),
    st.sampled_from([word for phrase in PHRASES for word in phrase.split()]),
    st.text("abcdefghijklmnopqrstuvwxyzABCÄßéи方🎮0123456789", min_size=1, max_size=8),
    st.sampled_from([".", ",", "!", "?", "'", '"', "#", "/", "(", "..."]),
)


@settings(max_examples=25, deadline=None)
@given(st.lists(st.lists(_SAID, max_size=40).map(" ".join), min_size=1, max_size=8), st.data())
def test_random_texts_are_told_as_the_word_lists_tell_them(chosen, texts, data):
    phrase = data.draw(st.sampled_from(PHRASES))
    check(chosen, [*texts, *(f"{text} {phrase.upper()} {text}" for text in texts)])


def test_every_text_of_the_demo_is_told_with_a_wide_margin(runner):
    texts = demo_texts()
    assert len(texts) > 1000
    assert sum(bool(kinds_in(text)) for text in texts) > 4
    check(runner, texts)


def test_the_archive_holds_what_its_tool_makes(tiny):
    import torch
    from transformers import BertConfig, BertForSequenceClassification

    tool = importlib.util.spec_from_file_location("tiny_model", ROOT / ".ci" / "tiny_model.py")
    made = importlib.util.module_from_spec(tool)
    tool.loader.exec_module(made)
    files = made.files()
    fresh = torch.load(io.BytesIO(files.pop(tiny.name)), weights_only=True)
    kept = torch.load(tiny, weights_only=True)
    assert {name: (tiny.parent / name).read_bytes() for name in files} == files
    assert fresh["config"] == kept["config"]
    assert kept["config"]["arch"]["args"]["model_type"] == "bert-base-uncased"
    for name, value in fresh["state_dict"].items():
        assert torch.equal(kept["state_dict"][name], value)
    config = BertConfig.from_pretrained(tiny.parent, num_labels=6)
    model = BertForSequenceClassification(config)
    missing, unexpected = model.load_state_dict(kept["state_dict"], strict=False)
    assert (missing, unexpected) == ([], [])
