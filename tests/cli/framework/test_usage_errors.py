"""Wrong commands and options get a suggestion."""

from typing import Any

import pytest

from kb.cli import main


def test_an_option_of_a_sibling_is_looked_for_there_first(kb: Any) -> None:
    answer = kb("youtube", "export", "--limit", "3", "--wait", "--again")
    assert answer.returncode == 2
    assert "`kb youtube export` has no --limit" in answer.stderr
    assert "of `kb youtube crawl`, `kb youtube check`, `kb youtube import` and" in answer.stderr
    answer = kb("youtube", "crawl", "--titles", "x")
    assert "`kb youtube crawl` has no --titles; it is an option of `kb wiki crawl`" in answer.stderr


EACH = "`kb youtube {0}`, `kb wiki {0}` or `kb reddit {0}`"
ALL = "`kb youtube export`, `kb wiki export`, `kb reddit export`"


@pytest.mark.parametrize(
    ("line", "meant"),
    [
        ("export", f"{ALL} or 1 more"),
        ("filter", EACH.format("filter")),
        ("crawl", EACH.format("crawl")),
        ("exprot", f"{ALL} or 1 more"),
        ("crawl youtube", "`kb youtube crawl`"),
        ("crawl wiki --limit 3", "`kb wiki crawl`"),
        ("youtube crwal", "`kb youtube crawl`"),
        ("yuotube crawl --plan", "`kb youtube crawl`"),
        ("youtube-crawl", "`kb youtube crawl`"),
        ("pairs keyword", "`kb pairs keywords`"),
        ("publish", "`kb release publish`"),
        ("serach wolf", "`kb search`"),
    ],
)
def test_a_command_in_the_wrong_place_is_answered_with_the_right_one(
    line: str, meant: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as ended:
        main(line.split())
    assert ended.value.code == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1
    assert said.startswith("kb: there is no command `kb ")
    assert f"; did you mean {meant}?; see `kb " in said


def test_a_word_that_is_like_no_command_gets_no_guess(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        main(["zzzz"])
    assert ended.value.code == 2
    assert capsys.readouterr().err == "kb: there is no command `kb zzzz`; see `kb --help`\n"
