"""Tests of `kb.store.rebuild_hint`."""

from __future__ import annotations

from pathlib import Path

import pytest

from kb.store.tables.reading import advice


@pytest.mark.parametrize(
    ("path", "said"),
    [
        ("clean/youtube/videos/part-0.parquet", "run `kb youtube filter` again"),
        (
            "clean/pairs/release/raw/clean/reddit/posts/part-0.parquet",
            "run `kb reddit filter` again",
        ),
        ("pairs/pairs-00000-of-00001.parquet", "run `kb pairs --again`"),
        ("release/pairs/pairs-00000-of-00001.parquet", "run `kb pairs --again`"),
        ("release/wiki/pages-00000-of-00001.parquet", "run `kb wiki export` again"),
        (
            "annotations/reddit/toxicity.parquet",
            "remove it, then run `kb reddit filter`: what it held is scored again",
        ),
        ("raw/youtube/tombstones.parquet", "run `kb verify --repair`: its copy takes its place"),
    ],
)
def test_how_a_file_is_made_again(path: str, said: str) -> None:
    assert advice(Path("/data") / path) == said
