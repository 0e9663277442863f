"""Tests of `kb.search.passage`."""

from kb.search.passage import RowsByKey, pieces, plain


def test_lines_are_joined_to_pieces_and_long_ones_are_divided() -> None:
    assert list(pieces(["a b", "c", "d e f g h", "i"], 3)) == ["a b\nc", "d e f", "g h\ni"]
    assert list(pieces([])) == []


def test_rows_of_a_second_table_by_key() -> None:
    rows = RowsByKey(iter([{"k": 1, "v": "a"}, {"k": 3, "v": "b"}, {"k": 3, "v": "c"}]), "k")
    assert [[row["v"] for row in rows.of(key)] for key in (0, 1, 2, 3, 4)] == [
        [],
        ["a"],
        [],
        ["b", "c"],
        [],
    ]


def test_plain_text_has_no_control_characters_and_composed_letters() -> None:
    assert plain(None) == ""
    assert plain("a\x00b\ttab") == "a b\ttab"
    assert plain("cafe\u0301") == "café"
