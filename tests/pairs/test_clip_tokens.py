"""Token counts are CLIP's own."""

import numpy as np
import pytest

from kb.pairs.clip_tokens import Tokens
from kb.pairs.transcript_batch import Text
from tests.pairs.conftest import transcripts

# Published encodings: the notebooks and tests of openai/CLIP and of Hugging Face's CLIPTokenizer.
KNOWN = {
    "a photo of a cat": [320, 1125, 539, 320, 2368],
    "a photo of a dog": [320, 1125, 539, 320, 1929],
    "Hello World!": [3306, 1002, 256],
    "a diagram": [320, 22697],
}


@pytest.fixture(scope="module")
def counter() -> Tokens:
    return Tokens()


@pytest.mark.parametrize("text", KNOWN)
def test_known_encodings(counter: Tokens, text: str) -> None:
    assert counter._encode(text) == KNOWN[text]
    assert counter.count(text) == len(KNOWN[text])


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
