"""Tests of `kb.store.rawlog.quarantine`."""

import shutil

import pytest
import zstandard

from kb.core.errors import DamagedData
from kb.store.rawlog import quarantine, rawlog
from kb.store.rawlog.recorder import Recorder
from kb.store.state.frontier import Frontier
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


def test_a_replay_takes_back_what_no_raw_answer_says(tmp_path):
    """Of a damaged frame its item is lost; the ledger, cursors and items of a list stay."""
    frontier = open_frontier(tmp_path)
    frontier.spend("general", 5, "videos.list")
    with Recorder(tmp_path, "youtube", frontier, apply, asked=["video"]) as recorder:
        frontier.set_cursor("round", 3)
        frontier.add_keys("video", ["named"])
        for number in range(3):
            recorder.record("videos", "videos", {"id": f"v{number}"}, 200, {})
    [path] = rawlog.segments(tmp_path, "youtube", "videos")
    frames = rawlog.Frames(path)
    start, _ = [(frames.start, end) for end, _ in frames][1]
    data = bytearray(path.read_bytes())
    data[start + 12] ^= 1
    path.write_bytes(data)

    quarantine.refuse_lost_answers(tmp_path, "youtube")  # nobody has read it yet
    with pytest.raises(DamagedData) as met, Recorder(tmp_path, "youtube", frontier, apply):
        list(rawlog.envelopes(tmp_path, "youtube", "videos"))
    assert "run the same command again" in met.value.hint
    with pytest.raises(DamagedData, match="lost are the answers of video v1"):
        Recorder(tmp_path, "youtube", frontier, apply, asked=["video"])
    assert frontier.counts("video") == {"done": 2, "todo": 2}
    assert (frontier.requests(), frontier.cursor("round")) == ((1, 5), 3)
    with pytest.raises(DamagedData, match="lost are the answers of video v1") as told:
        quarantine.refuse_lost_answers(tmp_path, "youtube")
    assert "kb youtube crawl" in told.value.hint
    with Recorder(tmp_path, "youtube", frontier, apply, asked=["video"]) as recorder:
        recorder.record("videos", "videos", {"id": "v1"}, 200, {})
    quarantine.refuse_lost_answers(tmp_path, "youtube")
    assert frontier.counts("video") == {"done": 3, "todo": 1}


@pytest.mark.parametrize("steps", [1, 2, 3])
def test_a_killed_replay_goes_on(tmp_path, steps, monkeypatch):
    """Whatever was done of it, the next run ends in the same state."""
    frontier = open_frontier(tmp_path)
    with Recorder(tmp_path, "youtube", frontier, apply, asked=["video"]) as recorder:
        frontier.add_keys("video", ["named"])
        for number in range(3):
            recorder.record("videos", "videos", {"id": f"v{number}"}, 200, {})
    [path] = rawlog.segments(tmp_path, "youtube", "videos")
    path.unlink()

    def killed(*arguments, **named):
        raise KeyboardInterrupt

    places = [(Frontier, "start_over"), (quarantine, "set_aside"), (Frontier, "settle")]
    with monkeypatch.context() as patch:
        patch.setattr(*places[steps - 1], killed)
        with pytest.raises(KeyboardInterrupt):
            Recorder(tmp_path, "youtube", frontier, apply, asked=["video"])
    frontier.close()
    frontier = open_frontier(tmp_path)
    with pytest.raises(DamagedData, match="lost are the answers of video v0"):
        Recorder(tmp_path, "youtube", frontier, apply, asked=["video"])
    assert frontier.counts("video") == {"todo": 4}
    assert frontier.lost() == [("video", f"v{number}") for number in range(3)]
    Recorder(tmp_path, "youtube", frontier, apply, asked=["video"]).close()
