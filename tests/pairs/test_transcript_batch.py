"""White space of every kind parts words, in as many bytes as it had."""

import sys

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from kb.pairs.transcript_batch import Text
from tests.pairs.conftest import transcripts

EVERY = [chr(code) for code in range(sys.maxunicode + 1) if chr(code).isspace()]
# Neighbours of wide spaces in UTF-8: the same first bytes, and letters.
NEAR = "a\xe9\u266d\u2019\u2014\u200b\u2027\u303f\u1681\U00012000\u0100"
texts = st.text(st.sampled_from([*EVERY, *NEAR]), max_size=12)


@given(st.lists(texts, max_size=4))
def test_spaced_is_the_text_with_plain_spaces(cues: list[str]) -> None:
    whole = Text(transcripts(("v", "asr", [(n, 1, text) for n, text in enumerate(cues)])))
    plain = "".join(" " * len(c.encode()) if c.isspace() else c for c in whole.given.decode())
    assert whole.raw.decode() == plain
    assert whole.word_count == sum(len(text.split()) for text in cues)
    assert whole.raw.decode().split() == " ".join(cues).split()


@pytest.mark.parametrize(
    ("captions", "spoken"),
    [
        ("[Music] hello [Applause] all", "hello all"),
        ("[Música] hola [ __ ] >> sí", "hola sí"),
        ("【音楽】岩 [音楽]", "【音楽】岩"),
        (">>> one > two >> three", "one > two three"),
        ("\u266a la la \u266b", "la la"),
        ("(that is what I said)", "(that is what I said)"),
        (f"a [{'never closed ' * 9}] b", f"a [{'never closed ' * 9}] b"),
        ("list[0] of [a [b] c]", "list of [a c]"),
    ],
)
def test_captions_of_sounds_are_no_words(captions: str, spoken: str) -> None:
    whole = Text(transcripts(("v", "asr", [(0, 1, captions)])))
    assert " ".join(whole.raw.decode().split()) == " ".join(spoken.split())
    end = np.array([len(whole.raw) - 1])
    assert whole.characters(end, np.array([0])).tolist() == [len(captions)]


def test_transcripts_are_kept_apart() -> None:
    whole = Text(transcripts(("v", "asr", [(0, 1, "a\u3000b")]), ("w", "asr", [(0, 1, "é\u0085")])))
    assert whole.raw == b" a   b \xff \xc3\xa9   "
    assert whole.word_count == 3
