"""`kb.load`: data roots, releases, SQL and notebooks."""

import shutil
from pathlib import Path
from typing import Any

import duckdb
import pytest

import kb
from kb.core.errors import UsageError
from tests.cli.test_app import NOT_FOR_HELP, imports_of


def direct(sql: str) -> list[tuple[Any, ...]]:
    return duckdb.sql(sql).fetchall()


def literal(path: Path) -> str:
    return "'" + str(path).replace("[", "[[]") + "'"


def test_one_folder_by_any_name_several_and_a_data_root(
    release: Path, root: Path, tmp_path: Path
) -> None:
    shutil.copytree(release / "youtube", tmp_path / "zenodo 1234")
    one = kb.load(tmp_path / "zenodo 1234")
    assert set(one.tables) == {"youtube_videos", "youtube_tombstones"}
    several = kb.load(tmp_path / "zenodo 1234", str(release / "pairs"))
    assert several.sql("SELECT count(*) AS n FROM pairs JOIN youtube_videos USING (video_id)")
    assert {"pairs", "youtube_videos"} <= set(
        kb.load([release / "pairs", release / "youtube"]).tables
    )
    with pytest.raises(UsageError, match=r"release\.youtube_videos is in .* and in "):
        kb.load(tmp_path / "zenodo 1234", release)
    whole = kb.load(root)
    assert "description" in whole["youtube_videos"].schema.names
    assert "description" not in whole["release.youtube_videos"].schema.names
    assert "restored.reddit_posts" in whole.tables


def test_a_root_of_one_source_only(root: Path, tmp_path: Path) -> None:
    shutil.copytree(root / "clean" / "youtube", tmp_path / "clean" / "youtube")
    data = kb.load(tmp_path)
    assert all(name.startswith("youtube_") for name in data.tables)
    assert len(data["youtube_videos"]) == 207
    for ask in (lambda: data.page("Saltstone"), lambda: data.thread("x"), lambda: data.clips("x")):
        with pytest.raises(UsageError):
            ask()


def test_sql_reads_and_does_nothing_else(release: Path) -> None:
    data = kb.load(release)
    answer = data.sql("SELECT keyword, count(*) AS clips FROM pairs GROUP BY ALL ORDER BY ALL")
    pattern = literal(release / "pairs" / "pairs-*.parquet")
    assert [tuple(row.values()) for row in answer] == direct(
        f"SELECT keyword, count(*) FROM {pattern} GROUP BY ALL ORDER BY ALL"
    )
    assert answer.to_pandas().shape == (len(answer), 2)
    for wrong in ("DROP VIEW pairs", "COPY pairs TO 'x.csv'", "SELECT * FROM '/etc/passwd'"):
        with pytest.raises(UsageError):
            data.sql(wrong)
    with pytest.raises(UsageError, match="youtube_videos") as caught:
        data.sql("FROM youtube_video")
    assert caught.value.hint == "data.tables lists the tables"
    assert caught.value.__notes__ == [caught.value.hint]


def orphaned(release: Path) -> str:
    """A post with a comment whose parent was left out."""
    pattern = literal(release / "reddit" / "comments-*.parquet")
    return str(direct(f"SELECT min(post_id) FROM {pattern} WHERE NOT parent_in_release")[0][0])


def test_everything_shows_itself_in_a_notebook(release: Path, root: Path) -> None:
    for place in (release, root):
        data = kb.load(place)
        page = data.page("Saltstone")
        shown = [
            data,
            data.tables,
            data["youtube_videos"],
            data.sql("FROM pairs LIMIT 3"),
            page,
            page.boxes("table"),
            data.thread(orphaned(release)),
        ]
        for one in shown:
            text = one._repr_html_()
            assert text.startswith("<div")
            assert text.count("<div") == text.count("</div>")
            assert len(text) < 100_000
        assert "data:image/jpeg" in page._repr_html_()
        assert page.boxes("table")._repr_html_() != page._repr_html_()


def test_import_kb_loads_nothing_heavy_and_no_picture_before_it_is_asked_for() -> None:
    heavy = set(NOT_FOR_HELP)
    assert not heavy & imports_of("import kb; assert 'load' in dir(kb)")
    assert not {"polars", "PIL", "pydantic", "matplotlib"} & imports_of("import kb; kb.load")
