"""Damaged files are named, whatever part of a query meets them."""

from pathlib import Path

import pytest

from kb import query
from kb.artifacts import manifest
from kb.core.errors import DamagedData, UsageError
from tests.query.conftest import rows


def test_pages_that_are_broken_name_their_file_also_while_rows_stream(root: Path) -> None:
    file = root / "clean/youtube/videos/part-00001.parquet"
    data = bytearray(file.read_bytes())
    data[4:200] = b"\xff" * 196
    file.write_bytes(data)
    with (
        query.connect(root) as con,
        pytest.raises(DamagedData, match=r"part-00001\.parquet can't be read"),
    ):
        query.select(con, "FROM clean.youtube_videos", root=root).read_all()


@pytest.mark.parametrize(
    "sql",
    [
        "SELECT count(*) FROM clean.youtube_videos",
        "SELECT max(title) FROM Youtube_Videos",
        "SUMMARIZE youtube_videos",
    ],
)
def test_a_changed_bit_never_changes_an_answer(root: Path, sql: str) -> None:
    path = next(root.glob("clean/youtube/videos/*.parquet"))
    manifest.record(root / "clean/youtube", "clean/youtube")
    with query.connect(root) as con:
        query.select(con, sql, root=root).read_all()
    data = bytearray(path.read_bytes())
    data[len(data) // 3] ^= 1
    path.write_bytes(data)
    with query.connect(root) as con:
        query.select(con, "FROM release.youtube_videos", root=root).read_all()  # another's files
        with pytest.raises(DamagedData, match=f"{path.name} can't be read: checksum mismatch"):
            query.select(con, sql, root=root).read_all()


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
