"""Words as numbers, duplicates by their bands, and words that recur over a channel."""

import random
from collections import Counter
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from kb.pairs import repeated_text
from kb.pairs.repeated_text import ALIKE, BANDS, bands_of, firsts, hash_of, hashed_words, runs
from kb.pairs.transcript_batch import Text
from tests.pairs.conftest import transcripts

WORDS = st.lists(st.text("abcé9", min_size=1, max_size=20), max_size=12)


INTRO = ["hello", "and", "welcome", "back", "to", "this", "small", "show", "of", "ours"]
SPOKEN = st.lists(st.sampled_from([*"abcdefghijk", "#"]), max_size=14)


@given(st.lists(WORDS, min_size=1, max_size=3))
def test_a_word_has_the_same_hash_wherever_it_stands(videos: list[list[str]]) -> None:
    rows = [(f"v{n}", "asr", [(0, 1, ", ".join(one).upper())]) for n, one in enumerate(videos)]
    made = hashed_words(Text(transcripts(*rows)))
    flat = [(word, n) for n, one in enumerate(videos) for word in one]
    spoken = [(word.replace("é", "É"), n) for word, n in flat]  # only ASCII is folded
    assert made.hash.tolist() == [hash_of(word) for word, _ in spoken]
    assert made.video.tolist() == [n for _, n in spoken]


@given(WORDS, WORDS)
def test_runs_are_equal_where_their_words_are(one: list[str], other: list[str]) -> None:
    text = Text(
        transcripts(("v", "asr", [(0, 9, " ".join(one))]), ("w", "asr", [(0, 9, " ".join(other))]))
    )
    hashes, inside = runs(hashed_words(text), 3)
    both = [*one, *other]
    said = [tuple(both[at : at + 3]) for at in range(max(len(both) - 2, 0))]
    assert len(set(hashes.tolist())) == len(set(said))
    assert inside.tolist() == [not at < len(one) < at + 3 for at in range(len(said))]


@given(st.lists(st.lists(st.integers(0, 2), min_size=BANDS, max_size=BANDS), max_size=12))
def test_a_cluster_is_what_alike_neighbours_connect(rows: list[list[int]]) -> None:
    """Bands of four hashes each: of a band that is equal all four are."""
    bands = np.array(rows, np.uint64).reshape(-1, BANDS) * np.uint64(0x0001_0001_0001_0001)
    first = firsts(bands).tolist()
    alike = [
        [sum(x == y for x, y in zip(one, other, strict=True)) >= ALIKE * BANDS for other in rows]
        for one in rows
    ]
    for number, head in enumerate(first):
        assert first[head] == head <= number
        cluster = [n for n, other in enumerate(first) if other == head]
        assert len(cluster) == 1 or any(alike[number][n] for n in cluster if n != number)


def test_an_edited_copy_has_bands_in_common_and_another_talk_has_none() -> None:
    talk = [f"word{n * n % 997}" for n in range(600)]
    copy = [*talk[:100], "changed", *talk[101:400], "again", *talk[401:]]
    other = [f"word{n * n % 991}" for n in range(600)]
    cues = [[(0, 9, " ".join(one))] for one in (talk, copy, other, talk[:20])]
    text = Text(transcripts(*((f"v{n}", "asr", one) for n, one in enumerate(cues))))
    video, bands = bands_of(hashed_words(text), len(text))
    assert video.tolist() == [0, 1, 2]  # the last one says too little
    assert firsts(bands).tolist() == [0, 0, 2]


def _plain(videos: list[tuple[str, list[str]]], row: int) -> list[bool]:
    """Which words of a video lie in a run of six that three videos of its channel have."""
    channel, words = videos[row]
    mine = [set(_runs(other)) for name, other in videos if name == channel]
    hits = [sum(run in one for one in mine) >= 3 for run in _runs(words)]
    return [any(hits[max(at - 5, 0) : at + 1]) for at in range(len(words))]


def _runs(words: list[str]) -> list[tuple[str, ...]]:
    return [tuple(words[at : at + 6]) for at in range(len(words) - 5)]


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
    sizes = Counter(channel for channel, _ in videos)
    of_channel = np.array([sizes[channel] for channel, _ in videos])
    assert repeated_text.shares(around, recurs, of_channel).tolist() == expected


def _talk(rng: random.Random, length: int) -> list[str]:
    """Unrelated talk of one domain: frequent words, and phrases that everybody says."""
    phrases = [[f"p{n}x{m}" for m in range(4)] for n in range(30)]
    words: list[str] = []
    while len(words) < length:
        rare = f"w{int(20 * rng.random() ** -1.2)}"
        words += rng.choice(phrases) if rng.random() < 0.1 else [rare]
    return words[:length]


def _heard(rng: random.Random, words: list[str], share: float) -> list[str]:
    """The same talk by another run of speech recognition: words replaced, dropped and inserted."""
    made: list[str] = []
    for word in words:
        kind = rng.choice("rdi") if rng.random() < share else ""
        made += {"": [word], "r": ["other"], "d": [], "i": [word, "more"]}[kind]
    return made


def _text(talks: list[list[str]]) -> Text:
    rows = [(f"v{n}", "asr", [(0, 9, " ".join(words))]) for n, words in enumerate(talks)]
    return Text(transcripts(*rows))


@pytest.mark.parametrize(("share", "found"), [(0.04, 0.95), (0.08, 0.6)])
def test_re_uploads_are_found_though_words_were_heard_otherwise(share: float, found: float) -> None:
    rng = random.Random(5)
    talks = [_talk(rng, rng.randint(150, 600)) for _ in range(400)]
    copies = [_heard(rng, words, share) for words in talks[:200]]
    video, bands = bands_of(hashed_words(_text([*talks, *copies])), 600)
    assert len(video) == 600
    first = firsts(bands)
    assert (first[400:] == np.arange(200)).mean() >= found
    assert (first[:400] == np.arange(400)).all()  # no talk is taken for another


@pytest.mark.parametrize("videos", [4, 12, 80])
def test_an_intro_recurs_and_other_talk_does_not(videos: int, tmp_path: Path) -> None:
    rng = random.Random(7)
    intro = _talk(rng, 30)
    intros = [_heard(rng, intro, 0.04) for _ in range(videos)]
    talks = [[*one, *_talk(rng, 300)] for one in intros]
    words = hashed_words(_text(talks))
    keys = repeated_text.keys_of(words, ["a channel"] * videos)
    once = repeated_text.once_a_video(keys, words.video[: len(keys)])
    np.save(tmp_path / "keys.npy", np.sort(once))
    recurs = repeated_text.recurring([tmp_path / "keys.npy"])
    starts = np.searchsorted(words.video, np.arange(videos))
    ends = starts + [len(one) for one in intros]
    sizes = np.full(videos, videos)
    within = repeated_text.shares(repeated_text.around(keys, starts, ends), recurs, sizes)
    later = repeated_text.shares(repeated_text.around(keys, ends, ends + 60), recurs, sizes)
    assert (within > 0.4).mean() >= 0.9
    assert (later <= 0.2).mean() >= 0.9
