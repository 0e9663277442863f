"""White space of every kind parts words, in as many bytes as it had."""

import re
import sys

import numpy as np
import pyarrow as pa
import pytest
from hypothesis import given
from hypothesis import strategies as st

from kb.pairs.transcript_batch import Text
from tests.pairs.conftest import transcripts

EVERY = re.findall(r"\s", "".join(map(chr, range(sys.maxunicode + 1))))
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


WORDS = st.sampled_from(["a", "[Music]", ">>b", "\u3000c", "é"])


@given(st.lists(st.lists(WORDS, max_size=6), max_size=5))
def test_words_have_the_times_of_their_track(cues: list[list[str]]) -> None:
    """A cue of 3 s every 4 s, a word every 0.5 s; the last one ends after a second at most."""
    made = [
        (
            4.0 * number,
            3.0,
            " ".join(words),
            None if number % 3 == 2 else [4.0 * number + 0.5 * n for n in range(len(words))],
        )
        for number, words in enumerate(cues)
    ]
    whole = Text(transcripts(("v", "asr", made)))
    expected, after, own = [], [], []
    for number, (_, _, text, starts) in enumerate(made):
        spoken = text.split()
        for place, word in enumerate(spoken):
            if word == "[Music]":
                continue
            timed = starts is not None
            own.append(timed)
            start = 4_000 * number + 500 * place
            last = place == len(spoken) - 1
            expected.append(start if timed else None)
            end = min(start + 1_000, 4_000 * number + 3_000) if last else start + 500
            after.append(end if timed else None)
    begin, end = whole.time_of(whole.words), whole.time_of(whole.words, after=True)
    assert whole.timed(whole.words).tolist() == own
    assert [t if k else None for t, k in zip(begin.tolist(), own, strict=True)] == expected
    assert [t if k else None for t, k in zip(end.tolist(), own, strict=True)] == after


def test_times_that_do_not_fit_their_words_are_not_used() -> None:
    whole = Text(transcripts(("v", "asr", [(1.0, 2.0, "a b", [1.0])])))
    assert not whole.timed(whole.words).any()
    assert whole.time_of(whole.words).tolist() == [1_000, 2_000]


def test_words_a_second_are_spoken_words_by_the_length_of_the_video() -> None:
    ten = [(0, 1, "[Music] " + "word " * 5), (1, 1, ">> five more of these\u3000words")]
    rows = transcripts(("a", "asr", ten), ("b", "asr", []), ("c", "manual", ten))
    rates = Text(rows, pa.array([4.0, 4.0, None])).words_per_second
    assert rates.tolist() == [2.5, 0, 5]
