"""Clusters of videos by their bands."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from kb.pairs.repeated_text import BANDS, bands_of, firsts, hashed_words
from kb.pairs.transcript_batch import Text
from tests.pairs.conftest import transcripts


@given(st.lists(st.lists(st.integers(0, 6), min_size=BANDS, max_size=BANDS), max_size=12))
def test_a_cluster_is_what_bands_connect(rows: list[list[int]]) -> None:
    first = firsts(np.array(rows, np.uint64).reshape(-1, BANDS))
    known = list(range(len(rows)))
    for _ in rows:  # as often as a chain can be long
        for a, one in enumerate(rows):
            for b, other in enumerate(rows):
                if any(x == y for x, y in zip(one, other, strict=True)):
                    known[a] = known[b] = min(known[a], known[b])
    assert first.tolist() == known


def test_an_edited_copy_has_bands_in_common_and_another_talk_has_none() -> None:
    talk = [f"word{n * n % 997}" for n in range(600)]
    copy = [*talk[:100], "changed", *talk[101:400], "again", *talk[401:]]
    other = [f"word{n * n % 991}" for n in range(600)]
    cues = [[(0, 9, " ".join(one))] for one in (talk, copy, other, talk[:20])]
    text = Text(transcripts(*((f"v{n}", "asr", one) for n, one in enumerate(cues))))
    made = bands_of(hashed_words(text), len(text))
    assert made.video.tolist() == [0, 1, 2]  # the last one says too little
    assert firsts(made.bands).tolist() == [0, 0, 2]
