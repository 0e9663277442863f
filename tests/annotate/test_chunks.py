"""Chunks of texts adapt their size to the speed of the model."""

from kb.annotate import toxicity
from kb.annotate.scores import Scores
from kb.core.progress import Task


def test_a_chunk_grows_and_shrinks_with_the_time_it_takes(tmp_path):
    """A stop waits for the chunk in hand, so that a slow model gets small ones and a fast one large
    ones.
    """
    scores = Scores(str(tmp_path), "m", "r")
    given = toxicity.Chunks(scores, None, None, Task())
    sizes = []
    seconds = iter([0.1] * 6 + [60.0] * 4 + [4.0] * 100)
    for hashes, texts in given.of([[f"text {n}" for n in range(9000)]]):
        assert len(hashes) == len(texts)
        sizes.append(len(texts))
        given.took(next(seconds))
    assert sum(sizes) == 9000
    assert sizes[:6] == [32, 64, 128, 256, 512, 1024]
    assert sizes[7:10] == [512, 256, 128]
    assert set(sizes[10:-1]) == {64}
    long = toxicity.Chunks(scores, None, None, Task())
    first, _ = next(iter(long.of([["x" * 10_000 + str(n) for n in range(20)]])))
    assert len(first) == 4, "characters count too"
