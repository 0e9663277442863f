"""Tests of `kb.pairs.keyword_hits`."""

from kb.core.context import Run
from kb.pairs.keyword_hits import keyword_lines


def test_keywords_with_examples(run: Run) -> None:
    lines = {line.keyword: line for line in keyword_lines(run, examples=2)}
    assert lines["Creeper"].matches > 30
    assert len(lines["Creeper"].examples) == 2
    assert "[creeper]" in lines["Creeper"].examples[0]
    assert lines["Bed"].rule == "near:20"
    assert lines["Bed"].alone > 0
    assert list(keyword_lines(run, examples=2)) == list(lines.values())
    assert {line.kind for line in keyword_lines(run, kind="entity")} == {"entity"}
