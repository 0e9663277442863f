"""Token counts are CLIP's own."""

from __future__ import annotations

import numpy as np
import pytest

from kb.pairs.grow import near
from kb.pairs.text import Text
from kb.pairs.tokens import Tokens
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
    counts = counter.of_words(whole.spaced, whole.words, np.ones(len(whole.words), bool))
    assert counts.tolist() == [counter.count(word) for word in text.split()]
    assert counts.sum() == counter.count(text)


@pytest.mark.parametrize("size", [1, 3, 40])
def test_words_near_phrases_are_all_that_a_text_can_grow_to(size: int) -> None:
    """With long words, too, of which a stretch that is wide enough for others holds few."""
    text = " ".join(f"{number:0{size}}" for number in range(3_000))
    whole = Text(transcripts(*((key, "asr", [(0, 1, text)]) for key in "vw")))
    places = whole.words[[0, 1, 1500, 1502, 2998, 2999, 3001, 5000]]
    video = whole.video_of(places)
    words, begin, stop = near(whole, places, places + size, video, 77)
    every = whole.words
    assert len(words) < len(every) / 4
    for place, first, behind, of in zip(places, begin, stop, video, strict=True):
        at = int(np.searchsorted(every, place))
        low = max(at - 78, int(np.searchsorted(every, whole.video_at[of])))
        high = min(at + 78, int(np.searchsorted(every, whole.video_end[of])))
        found = words[first:behind].tolist()
        assert set(every[low:high].tolist()) <= set(found)
        own = every[np.searchsorted(every, found[0]) :][: len(found)].tolist()
        assert found == own  # one behind the other, none left out


def test_only_wanted_words_are_counted(counter: Tokens) -> None:
    whole = Text(transcripts(("v", "asr", [(0, 1, "creeper oak creeper")])))
    known = dict(counter._known)
    assert counter.of_words(whole.spaced, whole.words, np.array([False, False, True])).tolist() == [
        0,
        0,
        counter.count("creeper"),
    ]
    assert set(counter._known) - set(known) <= {b"creeper "}
