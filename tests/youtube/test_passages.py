"""Tests of `kb.youtube.passages`."""

from kb.youtube.passages import LEAST, MOST, talk


def test_windows_end_where_the_talk_pauses() -> None:
    words = " ".join(["word"] * 10)
    starts = [0.0, 3, 6, 9, 12, 15, 18, 25, 28, 31, 34, 37, 40, 43, 46, 49]
    said = talk(starts, [3.0] * 16, [words] * 16)
    found = list(said.windows())
    assert [starts[begin] for begin, _ in found] == [0.0, 25]  # before the pause from 21 to 25
    assert [n for begin, after in found for n in range(begin, after)] == list(range(16))
    even = talk([3.0 * n for n in range(100)], [3.0] * 100, [words] * 100).windows()
    sizes = [10 * (after - begin) for begin, after in even]
    assert sum(sizes) == 1000
    assert all(LEAST <= size <= MOST for size in sizes[:-1])


def test_cues_without_words_or_times_and_of_too_many_words() -> None:
    said = talk(
        [None, 1.0, -5.0, 20.0], [None, 2.0, 1.0, 10.0], ["", None, "a\nb ", "x " * (MOST + 1)]
    )
    assert said.texts[0] == "a b"
    assert [len(text.split()) for text in said.texts] == [2, MOST, 1]
    assert said.starts == [0.0, 20.0, round(20 + 10 * MOST / (MOST + 1), 2)]
    assert said.ends[-1] == 30.0
    assert list(talk([], [], []).windows()) == []
