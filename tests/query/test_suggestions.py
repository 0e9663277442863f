"""Wrong names and queries: one line, with the nearest names."""

from pathlib import Path

import pytest

from kb.core.errors import UsageError
from tests.query.conftest import rows


@pytest.mark.parametrize(
    ("sql", "said", "hint"),
    [
        (
            "SELECT titel FROM youtube_videos",
            'Referenced column "titel" not found in FROM clause! Candidate bindings: "title"',
            "--tables",
        ),
        (
            "SELECT * FROM youtube_video",
            "Table with name youtube_video does not exist! Did you mean youtube_videos?",
            "--tables",
        ),
        (
            "SELECT * FROM wiki_pages",
            "Table with name wiki_pages does not exist!",
            "`kb wiki crawl`, then `kb wiki filter`",
        ),
        ("SELEC 1", 'syntax error at or near "SELEC"', "--tables"),
        ("", "is empty", ""),
        ("SELECT 1; SELECT 2", "2 statements", ""),
        ("SELECT 'x'::INT", "Could not convert string 'x' to INT32", ""),
    ],
)
def test_a_mistake_is_one_line_with_a_hint(root: Path, sql: str, said: str, hint: str) -> None:
    with pytest.raises(UsageError) as caught:
        rows(root, sql)
    assert said in str(caught.value)
    assert "\n" not in str(caught.value)
    assert hint in caught.value.hint


@pytest.mark.parametrize(
    ("sql", "guess", "never"),
    [
        ("FROM youtube_vidoes", "Did you mean youtube_videos", "pairs"),
        ("FROM relase.youtube_videos", "release.youtube_videos", "rejected"),
        ("FROM release.youtube_vidoes", "Did you mean release.youtube_videos", "reddit"),
        ("SELECT v.titel FROM youtube_videos v", "Did you mean title", "width"),
        ("SELECT titel FROM youtube_videos", 'Candidate bindings: "title"', "width"),
    ],
)
def test_an_unknown_name_is_told_with_the_nearest_alone(
    root: Path, sql: str, guess: str, never: str
) -> None:
    with pytest.raises(UsageError) as caught:
        rows(root, sql)
    said = f"{caught.value}; {caught.value.hint}"
    assert guess in said
    assert never not in said
    assert len(said) < 250
