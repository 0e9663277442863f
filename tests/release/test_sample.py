"""Samples are small and hold whole groups."""

import json
from pathlib import Path

from kb.release import sample
from kb.release.folders import in_root
from tests.release.made import build


def test_sample_is_bounded_and_whole_groups(tmp_path: Path) -> None:
    build(tmp_path, sources=("reddit",), n=5000)
    folder = in_root(tmp_path)[0]
    total = sum(path.stat().st_size for path in folder.data)
    written = sample.write(folder, total / 4 / 1e6)
    assert sum(path.stat().st_size for path in written) <= total / 4
    posts, comments = (
        [row["post_id"] for row in json.loads(path.read_text(encoding="utf-8"))]
        for path in sorted(written, reverse=True)
    )
    posts = set(posts)
    assert set(comments) == posts
    assert len(comments) == 3 * len(posts)
