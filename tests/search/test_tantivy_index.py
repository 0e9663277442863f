"""Tests of `kb.search.tantivy_index`."""

from pathlib import Path

from kb.search import tantivy_index
from kb.search.passage import Passage
from kb.search.query import question
from kb.search.ranking import Only, Weights, rank
from kb.search.tantivy_index import PassageIndex


def test_the_same_rows_give_the_same_answers_in_any_number_of_segments(tmp_path: Path) -> None:
    passages = [
        Passage("post", f"t3_{n}", f"{n // 3}", "t", f"an elm and {n % 7} oaks", "", "2023-01-01")
        for n in range(20_000)
    ]
    indexes = []
    for name, heap in (("small", 30 << 20), ("large", 256 << 20)):
        (tmp_path / name).mkdir()
        tantivy_index.write(tmp_path / name, "", passages, lambda _: None, heap)
        indexes.append(PassageIndex(tmp_path / name, ""))
    for words in ("elm", "6 oaks", "oaks elm 3"):
        asked = question(words)
        first, again = (
            [
                (one.score, one.number, index.passage(one.address))
                for one in rank(by_source, asked, Weights(by_source, asked), Only(limit=50))
            ]
            for index in indexes
            for by_source in [{"reddit": index}]
        )
        assert first == again
        assert [number for _, number, _ in first] == sorted(number for _, number, _ in first)
