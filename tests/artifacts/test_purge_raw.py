"""Purge reads what may hold a key and skips the rest, and finds as much as by reading all."""

import json
from pathlib import Path
from typing import Any

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from kb.artifacts.purge_raw import Matcher, changed_frames, rewrite_segment, strip_by_schema
from kb.reddit.purge import texts
from kb.store.rawlog import rawlog
from kb.store.rawlog.rawlog import Envelope, Request

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
    if strip_by_schema("youtube", "videos", kept, {"": set(gone)}) is not kept:
        assert Matcher(gone)(line)
        assert Matcher(gone)(json.dumps(json.loads(line)).encode())  # whatever else wrote it


@pytest.fixture
def segment(tmp_path: Path) -> Path:
    writer = rawlog.Segment(rawlog.folder(tmp_path, "youtube", "videos"))
    for number in range(60):
        ids = [f"v{number:03d}", f"w{number:03d}"]
        writer.append(rawlog.encode(envelope(",".join(ids), ids)))
    writer.close()
    (path,) = rawlog.segments(tmp_path, "youtube", "videos")
    return path


def test_only_answers_that_may_hold_a_key_are_decoded(segment: Path) -> None:
    seen: list[str] = []
    gone = {"v007", "v040", "w040"}

    def strip(one: Envelope) -> Envelope | None:
        seen.append(one.request.params["id"])
        return strip_by_schema("youtube", "videos", one, {"": gone})

    before = segment.read_bytes()
    frames = list(rawlog.Frames(segment))
    assert rewrite_segment(segment, changed_frames(segment, Matcher(gone), strip)) == 2
    assert seen == ["v007,w007", "v040,w040"]
    left = [one for _, one in rawlog.Frames(segment)]
    lines = [line for _, line in frames]
    assert left == [
        *lines[:7],
        rawlog.encode(envelope("w007", ["w007"])),
        *lines[8:40],
        *lines[41:],
    ]
    # Frames without a key are the same bytes.
    assert segment.read_bytes().startswith(before[: frames[6][0]])
    assert segment.read_bytes().endswith(before[frames[40][0] :])

    again = segment.stat().st_mtime_ns
    assert rewrite_segment(segment, changed_frames(segment, Matcher(gone), strip)) == 0
    assert segment.stat().st_mtime_ns == again  # nothing to take out: not written again


@pytest.mark.parametrize("name", ["t1_ab", "t3_ab"])
def test_a_short_id_within_another_word_is_not_a_key(name: str) -> None:
    matches = Matcher(texts({name, "t1_abc"}))
    assert not matches(b'{"id":"abcd","link_id":"t3_xab","body":"cab, drab; xabc"}')
    for line in (
        b'{"id":"ab"}',
        b'"t3_ab"',
        b'"t1_x,t1_ab"',
        b'"abc"',
        b'"\\u0061b"',
        b'"abab","ab"',
    ):
        assert matches(line), line
