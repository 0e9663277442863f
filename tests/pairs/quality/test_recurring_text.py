"""Words in runs that recur over a channel, against plain counting."""

from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from kb.pairs import repeated_text
from kb.pairs.repeated_text import hashed_words
from kb.pairs.transcript_batch import Text
from tests.pairs.conftest import transcripts

INTRO = ["hello", "and", "welcome", "back", "to", "this", "small", "show", "of", "ours"]
SPOKEN = st.lists(st.sampled_from([*"abcdefghijk", "#"]), max_size=14)


def _plain(videos: list[tuple[str, list[str]]], row: int) -> list[bool]:
    """Which words of a video lie in a run of eight that three videos of its channel have."""
    channel, words = videos[row]
    mine = [set(_runs(other)) for name, other in videos if name == channel]
    hits = [sum(run in one for one in mine) >= 3 for run in _runs(words)]
    return [any(hits[max(at - 7, 0) : at + 1]) for at in range(len(words))]


def _runs(words: list[str]) -> list[tuple[str, ...]]:
    return [tuple(words[at : at + 8]) for at in range(len(words) - 7)]


@given(st.lists(st.tuples(st.sampled_from("xy"), SPOKEN), min_size=1, max_size=8), st.data())
def test_the_share_of_a_text_that_recurs(
    drawn: list[tuple[str, list[str]]], data: st.DataObject
) -> None:
    videos = [
        (channel, [w for one in words for w in (INTRO if one == "#" else [one])])
        for channel, words in drawn
    ]
    rows = [(f"v{n}", "asr", [(0, 9, " ".join(words))]) for n, (_, words) in enumerate(videos)]
    words = hashed_words(Text(transcripts(*rows)))
    keys = repeated_text.keys_of(words, [channel for channel, _ in videos])
    with TemporaryDirectory() as folder:
        files = []
        for half in (0, 1):  # as of two parts
            mine = words.video[: len(keys)] % 2 == half
            once = repeated_text.once_a_video(keys[mine], words.video[: len(keys)][mine])
            files.append(Path(folder, f"{half}.npy"))
            np.save(files[-1], np.sort(once))
        recurs = repeated_text.recurring(files)
    starts = np.searchsorted(words.video, np.arange(len(videos)))
    first, after, expected = [], [], []
    for row, (_, said) in enumerate(videos):
        low = data.draw(st.integers(0, len(said)))
        high = data.draw(st.integers(low, len(said)))
        first.append(starts[row] + low)
        after.append(starts[row] + high)
        inside = _plain(videos, row)[low:high]
        expected.append(sum(inside) / max(len(inside), 1))
    around = repeated_text.around(keys, np.array(first), np.array(after))
    assert repeated_text.shares(around, recurs).tolist() == expected
