"""Tests of `kb.search.passage`."""

from kb.search.passage import pieces, plain


def test_lines_are_joined_to_pieces_and_long_ones_are_divided() -> None:
    assert list(pieces(["a b", "c", "d e f g h", "i"], 3)) == ["a b\nc", "d e f", "g h\ni"]
    assert list(pieces([])) == []


def test_plain_text_has_no_control_characters_and_composed_letters() -> None:
    assert plain(None) == ""
    assert plain("a\x00b\ttab") == "a b\ttab"
    assert plain("cafe\u0301") == "café"
