"""Tests of `kb.search.snippet`."""

from types import SimpleNamespace
from typing import Any

from kb.search.snippet import MOST, snippet
from kb.search.tantivy_index import analyzer


def term(word: str) -> Any:
    """A term of one word, as `snippet` reads it from an index."""
    return SimpleNamespace(
        words=[word], places=lambda words: [at for at, one in enumerate(words) if one == word]
    )


def test_the_marked_words_are_shown_and_the_rest_is_cut() -> None:
    text = " ".join(["dirt"] * 100 + ["wolf"] + ["sand"] * 100)
    shown = snippet(text, analyzer(""), [term("wolf")])
    assert shown.text.startswith("…dirt")
    assert shown.text.endswith("sand…")
    assert "**wolf**" in shown.text
    assert len(shown.text.split()) == MOST
    assert shown.marks == [(500, 1)]


def test_without_a_mark_the_text_begins() -> None:
    assert snippet("A short\ntext", analyzer(""), [term("wolf")]) == ("A short text", [])
