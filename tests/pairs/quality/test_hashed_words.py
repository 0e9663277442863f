"""Words as numbers."""

from hypothesis import given
from hypothesis import strategies as st

from kb.pairs.repeated_text import hash_of, hashed_words, runs
from kb.pairs.transcript_batch import Text
from tests.pairs.conftest import transcripts

WORDS = st.lists(st.text("abcé9", min_size=1, max_size=20), max_size=12)


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
