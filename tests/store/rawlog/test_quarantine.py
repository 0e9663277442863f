"""Tests of `kb.store.rawlog.quarantine`."""

import shutil

import pytest
import zstandard

from kb.core.errors import DamagedData
from kb.store.rawlog import quarantine, rawlog
from kb.store.rawlog.recorder import Recorder
from tests.store.rawlog.test_rawlog import written
from tests.store.rawlog.test_recorder import apply, counted
from tests.store.state.test_frontier import open_frontier


@pytest.mark.parametrize("how", ["another", "not an envelope", "cut"])
def test_a_damaged_segment_that_the_state_does_not_know_is_set_aside(tmp_path, how):
    """It is read once; what came before the damage is not taken in twice."""
    frontier = open_frontier(tmp_path)
    with Recorder(tmp_path, "youtube", frontier, apply) as recorder:
        for number in range(5):
            recorder.record("videos", "videos", {"id": f"v{number}"}, 200, {})
    frontier.close()
    shutil.rmtree(tmp_path / "state")
    [path] = rawlog.segments(tmp_path, "youtube", "videos")
    frames = rawlog.Frames(path)
    places = [(frames.start, end) for end, _ in frames]
    start, end = places[-1] if how == "cut" else places[2]
    odd = rawlog.compressor().compress(b"a note\n") if how == "not an envelope" else b"\xff" * 9
    whole = path.read_bytes()
    path.write_bytes(whole[:start] + odd + (b"" if how == "cut" else whole[end:]))

    frontier = open_frontier(tmp_path)
    with pytest.raises(DamagedData, match=f"{len(odd)} bytes at {start}") as said:
        Recorder(tmp_path, "youtube", frontier, counted)
    aside = path.with_name(f"{path.name}.damaged-{start}")
    assert aside.name in str(said.value)
    assert aside.read_bytes() == odd
    assert (frontier.counts("video"), frontier.cursor("applied")) == ({"done": 4}, 4)
    assert frontier.offset("videos", rawlog.base_name(path)) == path.stat().st_size
    Recorder(tmp_path, "youtube", frontier, counted)
    assert frontier.cursor("applied") == 4


@pytest.mark.parametrize("summed", [True, False], ids=["summed", "not summed"])
@pytest.mark.parametrize(
    "line",
    [b"a note\n", b'{"status":200}\n', b'{"fetched_at":null,"request"', b"\n", b""],
    ids=["text", "other JSON", "cut off", "blank", "empty"],
)
def test_a_whole_frame_without_an_envelope_is_damage(tmp_path, line, summed):
    """Which frames are decoded for that must not be seen."""
    written(tmp_path, 2)
    [path] = rawlog.segments(tmp_path, "youtube", "videos")
    good = path.read_bytes()
    odd = zstandard.ZstdCompressor(write_checksum=summed).compress(line)
    path.write_bytes(good + odd + good)
    assert quarantine.gaps(path, path.stat().st_size) == [(len(good), len(good) + len(odd))]
