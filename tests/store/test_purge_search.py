"""Purge reads what may hold a key and skips the rest, and finds as much as by reading all."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from kb.crawl.purge import strip_of
from kb.schema.keys import fields
from kb.store import purge, rawlog
from kb.store.frontier import Frontier
from kb.store.purge_search import finder, search, standing
from kb.store.rawlog import Envelope, Request

keys = st.text(min_size=1, max_size=4) | st.sampled_from(["a", "é", 'q"', "b\\c", "7", "x/y", "\n"])


def envelope(asked: str, ids: list[Any]) -> Envelope:
    response = {"items": [{"id": one, "snippet": {"title": "t"}} for one in ids]}
    return Envelope("2026-01-01T00:00:00Z", Request("videos.list", {"id": asked}), 200, response)


@given(st.lists(keys, max_size=3), st.lists(keys | st.integers(0, 99), max_size=3), st.lists(keys))
@example(["é"], ["é"], ["é"])
@example([], [7], ["7"])
def test_no_answer_with_a_key_is_skipped(asked: list[str], ids: list[Any], gone: list[str]) -> None:
    made = envelope(",".join(asked), ids)
    _, line = rawlog.storable(made)
    kept = rawlog.decode(line)
    if strip_of("youtube")("videos", kept, set(gone)) is not kept:
        for holds in (finder(gone), standing(gone, fields("youtube/videos"))):
            assert holds(line)
            assert holds(json.dumps(json.loads(line)).encode())  # whatever else wrote it


def test_a_key_in_another_field_is_not_looked_at() -> None:
    assert fields("youtube/videos") == {"id"}
    assert fields("youtube/transcripts") == {"video_id"}
    assert fields("youtube/playlist_items") == {"videoId"}
    assert not fields("wiki/pages")  # titles go with a page's key
    assert not fields("reddit/comments")  # bare ids
    assert not fields("youtube/nothing")
    holds = standing(["v1", "7"], {"id"})
    for line in (b'{"id":"v12","title":"v1"}', b'{"text":"id","v":"v1"}'):
        assert not holds(line)
    for line in (b'{"id": "v1"}', b'{"id":"v0,v1"}', b'{"id":7}', b'{"id":["v1"]}', b'"id":"v\\/'):
        assert holds(line)


@pytest.fixture
def segment(tmp_path: Path) -> Path:
    writer = rawlog.Segment(rawlog.folder(tmp_path, "youtube", "videos"))
    for number in range(60):
        ids = [f"v{number:03d}", f"w{number:03d}"]
        writer.append(rawlog.encode(envelope(",".join(ids), ids)))
    writer.close()
    (path,) = rawlog.segments(tmp_path, "youtube", "videos")
    return path


def test_only_answers_that_may_hold_a_key_are_decoded(segment: Path, tmp_path: Path) -> None:
    seen: list[str] = []

    def strip(kind: str, one: Envelope, gone: Any) -> Envelope | None:
        seen.append(one.request.params["id"])
        return strip_of("youtube")(kind, one, gone)

    before = segment.read_bytes()
    frames = list(rawlog.Frames(segment))
    frontier = Frontier(tmp_path / "state" / "youtube.sqlite")
    gone = {"v007", "v040", "w040"}
    found = search(tmp_path, "youtube", finder(gone))
    assert purge.rewrite_raw(tmp_path, "youtube", gone, strip, frontier, found) == 2
    assert seen == ["v007,w007", "v040,w040"]
    left = [one for _, one in rawlog.Frames(segment)]
    assert left[7] == rawlog.encode(envelope("w007", ["w007"]))
    assert left == [one for n, (_, one) in enumerate(frames) if n not in (7, 40)][:7] + left[
        7:8
    ] + [one for n, (_, one) in enumerate(frames) if n > 7 and n != 40]
    # Frames without a key are the same bytes.
    assert segment.read_bytes().startswith(before[: frames[6][0]])
    assert segment.read_bytes().endswith(before[frames[40][0] :])
    assert frontier.offset("videos", rawlog.base_name(segment)) == segment.stat().st_size

    again = segment.stat().st_mtime_ns
    assert search(tmp_path, "youtube", finder(gone)) == {}
    assert purge.rewrite_raw(tmp_path, "youtube", gone, strip, frontier, found={segment: []}) == 0
    assert segment.stat().st_mtime_ns == again  # nothing to take out: not written again


def test_only_the_segment_in_hand_is_read_again_after_a_kill(tmp_path: Path) -> None:
    for number in range(3):
        writer = rawlog.Segment(rawlog.folder(tmp_path, "youtube", "videos"))
        writer.append(rawlog.encode(envelope(f"v{number},w", [f"v{number}", "w"])))
        writer.close()
    paths = rawlog.segments(tmp_path, "youtube", "videos")
    frontier = Frontier(tmp_path / "state" / "youtube.sqlite")
    for path in paths:
        frontier.set_offset("videos", rawlog.base_name(path), path.stat().st_size)

    def strip(kind: str, one: Envelope, gone: Any) -> Envelope | None:
        if one.request.params["id"].startswith("v1"):
            raise KeyboardInterrupt
        return strip_of("youtube")(kind, one, gone)

    found = search(tmp_path, "youtube", finder({"w"}))
    assert list(found) == paths
    with pytest.raises(KeyboardInterrupt):
        purge.rewrite_raw(tmp_path, "youtube", {"w"}, strip, frontier, found)
    known = [frontier.offset("videos", rawlog.base_name(path)) for path in paths]
    assert known == [paths[0].stat().st_size, 0, paths[2].stat().st_size]
