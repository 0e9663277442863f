"""Pairs of a keyword, with text, times and quality."""

import re
from pathlib import Path

import duckdb

from tests.explore.conftest import Explored


def test_pairs_of_a_keyword_in_the_order_of_the_video(demo_pages: Explored, demo: Path) -> None:
    root = demo / "data" / "demo" / "pairs"
    expected = duckdb.sql(
        f"""SELECT video_id, floor(clip_start_s)::BIGINT FROM read_parquet('{root}/pairs-*.parquet')
        WHERE keyword = 'Creeper' ORDER BY video_id, clip_start_s, pair_id"""
    ).fetchall()
    pages = -(-len(expected) // 20)
    found: list[tuple[str, int]] = []
    for page in range(1, pages + 1):
        text = demo_pages.ask(f"/pairs?keyword=creeper&page={page}").text
        found += [
            (video, int(start))
            for video, start in re.findall(r"watch\?v=([\w-]+)&amp;t=(\d+)s", text)
        ]
    assert found == expected
    assert f"<p>{len(expected):,} pairs.</p>" in text
    assert "<dt>language</dt>" in text


def test_a_release_says_that_it_has_no_text(release_pages: Explored) -> None:
    text = release_pages.ask("/pairs?keyword=creeper").text
    assert "The text was not restored" in text
    assert 'rel="noopener noreferrer" target="_blank"' in text
