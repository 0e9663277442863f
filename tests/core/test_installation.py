"""What is made for the user's cache by several processes at once is there once, and whole."""

import pytest

from kb.core.installation import making


def test_the_first_whole_one_stays(tmp_path):
    folder = tmp_path / "made"
    with making(folder, lambda: True) as first, making(folder, lambda: True) as second:
        assert first != second
        (first / "a").write_text("first")
        (second / "a").write_text("second")
    assert [path.name for path in tmp_path.iterdir()] == ["made"]
    assert (folder / "a").read_text() == "second", "the inner block ended first"


def test_a_damaged_one_is_replaced(tmp_path):
    folder = tmp_path / "made"
    folder.mkdir()
    (folder / "half").touch()
    with making(folder, lambda: False) as fresh:
        (fresh / "a").write_text("whole")
    assert [path.name for path in folder.iterdir()] == ["a"]


def test_nothing_is_left_of_a_failure(tmp_path):
    with pytest.raises(ValueError, match="no"), making(tmp_path / "made", lambda: False) as fresh:
        (fresh / "a").write_text("half")
        raise ValueError("no")
    assert not list(tmp_path.iterdir())
