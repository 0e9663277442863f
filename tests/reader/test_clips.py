"""Clips of a keyword."""

from pathlib import Path
from typing import Any

import duckdb
import pytest

import kb
from kb.core.errors import UsageError


def direct(sql: str) -> list[tuple[Any, ...]]:
    return duckdb.sql(sql).fetchall()


def literal(path: Path) -> str:
    return "'" + str(path).replace("[", "[[]") + "'"


def test_clips_join_pairs_videos_and_texts(release: Path, root: Path) -> None:
    clips = kb.load(release).clips("creeper").to_pylist()
    pairs, videos = (
        literal(release / folder / f"{folder if folder == 'pairs' else 'videos'}-*.parquet")
        for folder in ("pairs", "youtube")
    )
    assert [(row["pair_id"], row["title"], row["clip_end_s"]) for row in clips] == direct(
        f"SELECT pair_id, title, clip_end_s FROM {pairs} JOIN {videos} USING (video_id)"
        " WHERE keyword = 'Creeper' ORDER BY video_id, clip_start_s, pair_id"
    )
    assert {row["text"] for row in clips} == {None}
    first = clips[0]
    assert first["url"].endswith(f"?v={first['video_id']}&t={int(first['clip_start_s'])}s")
    whole = kb.load(root).clips("CREEPER").to_pylist()
    assert len(whole) == len(clips)
    assert all("creeper" in row["text"].lower() for row in whole)
    alone = kb.load(release / "pairs").clips("Creeper").to_pylist()
    assert {row["title"] for row in alone} == {None}
    by_word = kb.load(root).clips("creeper", "timing = 'word' AND clip_start_s > 20").to_pylist()
    assert by_word == [r for r in whole if r["timing"] == "word" and r["clip_start_s"] > 20] != []
    with pytest.raises(UsageError, match="timin"):
        kb.load(release).clips("creeper", "timin = 'word'")
    with pytest.raises(UsageError, match="Did you mean Creeper"):
        kb.load(release).clips("crepeer")
