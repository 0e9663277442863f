"""Token counts are CLIP's own."""

import hashlib
import json
from pathlib import Path

import numpy as np
import pytest

from kb.pairs import clip_tokens
from kb.pairs.clip_tokens import LENGTH, Tokens, token_ids
from kb.pairs.transcript_batch import Text
from tests.pairs.conftest import transcripts

# Published encodings: the notebooks and tests of openai/CLIP and of Hugging Face's CLIPTokenizer.
KNOWN = {
    "a photo of a cat": [320, 1125, 539, 320, 2368],
    "a photo of a dog": [320, 1125, 539, 320, 1929],
    "Hello World!": [3306, 1002, 256],
    "a diagram": [320, 22697],
}


# [text, ids] of 1,000 texts in many scripts, as instant-clip-tokenizer 0.1.1 gave them.
GOLDEN = Path(__file__).with_name("clip_tokens.ndjson")
# https://github.com/openai/CLIP/blob/main/clip/bpe_simple_vocab_16e6.txt.gz
SHA256 = "924691ac288e54409236115652ad4aa250f48203de50a9e4722a6ecd48d6804a"


@pytest.fixture(scope="module")
def counter() -> Tokens:
    return Tokens()


def test_the_vocabulary_is_the_published_file() -> None:
    assert hashlib.sha256(clip_tokens._VOCABULARY.read_bytes()).hexdigest() == SHA256


@pytest.mark.parametrize("text", KNOWN)
def test_known_encodings(counter: Tokens, text: str) -> None:
    assert token_ids(text).tolist() == padded(KNOWN[text])
    assert counter.count(text) == len(KNOWN[text])


def test_ids_of_a_thousand_texts(counter: Tokens) -> None:
    texts = [json.loads(line) for line in GOLDEN.read_text(encoding="utf-8").splitlines()]
    assert len(texts) == 1000
    wrong = [text for text, ids in texts if token_ids(text).tolist() != padded(ids)]
    assert wrong == []
    assert [counter.count(text) for text, _ in texts] == [len(ids) for _, ids in texts]


def padded(ids: list[int]) -> list[int]:
    """With both ends, cut and filled up to what CLIP reads."""
    whole = [49_406, *ids[: LENGTH - 2], 49_407]
    return whole + [0] * (LENGTH - len(whole))


def test_a_final_sigma_is_found_at_any_place(counter: Tokens) -> None:
    """Wherever it stands: not every lower case finds it after 16 ASCII letters."""
    for before in range(40):
        text = "a" * before + "\u039f\u03a3"
        assert token_ids(text).tolist() == token_ids(text.lower()).tolist()


def test_markers_in_a_text_are_text() -> None:
    for text in ("<|startoftext|>", "<|endoftext|>", "<start_of_text>", "a <END_OF_TEXT> b"):
        ids = token_ids(text).tolist()
        assert ids.count(49_406) == ids.count(49_407) == 1, text


@pytest.mark.parametrize(
    "text",
    [
        "don't  CREEPER's (it's)",
        "我的世界 ok",
        "🎉 é ß",
        "a\u00a0b c\u3000d",
        "1234 5,6",
        "<|startoftext|>x",
    ],
)
def test_a_text_has_the_tokens_of_its_words(counter: Tokens, text: str) -> None:
    whole = Text(transcripts(("v", "asr", [(0, 1, text)])))
    counts = counter.of_words(whole.codes, whole.words, np.ones(len(whole.words), bool))
    assert counts.tolist() == [counter.count(word) for word in text.split()]
    assert counts.sum() == counter.count(text)


def test_only_wanted_words_are_counted(counter: Tokens) -> None:
    whole = Text(transcripts(("v", "asr", [(0, 1, "creeper oak creeper")])))
    before = counter._count_word.cache_info().misses
    assert counter.of_words(whole.codes, whole.words, np.array([False, False, True])).tolist() == [
        0,
        0,
        counter.count("creeper"),
    ]
    assert counter._count_word.cache_info().misses - before <= 1
