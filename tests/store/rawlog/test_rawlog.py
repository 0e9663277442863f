"""The raw log: what was written whole is there, whatever happens behind it."""

import json
from urllib.parse import quote

import msgspec
import pytest
import zstandard
from hypothesis import given
from hypothesis import strategies as some

from kb.core.errors import DamagedData
from kb.net import redact
from kb.store.rawlog import rawlog
from kb.store.rawlog.rawlog import Envelope, Frames, Request, Segment
from kb.store.rawlog.recorder import Recorder, recover
from kb.store.state.frontier import Frontier


def envelope(number, text="x"):
    return Envelope(
        "2026-11-20T12:00:00Z",
        Request("videos", {"id": f"v{number}"}),
        200,
        {"items": [{"id": f"v{number}", "text": text}]},
    )


def written(root, count, close=True):
    segment = Segment(rawlog.folder(root, "youtube", "videos"))
    offsets = [segment.append(rawlog.encode(envelope(n)))[1] for n in range(count)]
    if close:
        segment.close()
    return offsets


def test_one_envelope_a_line_and_a_zstd_frame(tmp_path):
    written(tmp_path, 3)
    [path] = rawlog.segments(tmp_path, "youtube", "videos")
    data, lines = path.read_bytes(), []
    while data:
        frame = zstandard.ZstdDecompressor().decompressobj()
        lines.append(frame.decompress(data))
        data = frame.unused_data
    assert [json.loads(line)["request"] for line in lines] == [
        {"endpoint": "videos", "params": {"id": f"v{n}"}} for n in range(3)
    ]
    assert all(line.endswith(b"\n") and line.count(b"\n") == 1 for line in lines)


def test_the_open_segment_can_be_read_and_is_renamed_when_closed(tmp_path):
    segment = Segment(rawlog.folder(tmp_path, "youtube", "videos"))
    segment.append(rawlog.encode(envelope(1)))
    [path] = rawlog.segments(tmp_path, "youtube", "videos")
    assert path.name.endswith(".ndjson.zst.open")
    assert [
        entry.request.params["id"] for entry in rawlog.envelopes(tmp_path, "youtube", "videos")
    ] == ["v1"]
    segment.close()
    assert [
        path.name.endswith(".ndjson.zst") for path in rawlog.segments(tmp_path, "youtube", "videos")
    ] == [True]


def test_a_secret_that_an_answer_repeats_is_not_kept(tmp_path):
    key = "not-a-real-key/0123456789"
    answer = {
        "items": [],
        "selfLink": f"/search?q=a&key={quote(key, safe='')}",
        key: [{"key": key, "id": 12345678}],
        "other": "key=abc",
    }
    want = {
        "items": [],
        "selfLink": "/search?q=a&key=***",
        "***": [{"key": "***", "id": 12345678}],
        "other": "key=abc",
    }
    redact.know([key, "12345678", "items"])  # a short secret or a number is data's own
    try:
        seen = []
        frontier = Frontier(tmp_path / "state" / "youtube.sqlite")
        with Recorder(
            tmp_path, "youtube", frontier, lambda _, kind, envelope: seen.append(envelope)
        ) as recorder:
            seen.append(recorder.record("search", "search", {"q": "a"}, 200, answer))
        frontier.close()
    finally:
        redact.know([])
    assert [
        envelope.response for envelope in (*seen, *rawlog.envelopes(tmp_path, "youtube", "search"))
    ] == [want] * 3


@pytest.mark.parametrize("bytes_left", [1, 5, 30])
def test_a_torn_frame_is_cut_and_the_whole_ones_stay(tmp_path, bytes_left):
    offsets = written(tmp_path, 4, close=False)
    [path] = rawlog.segments(tmp_path, "youtube", "videos")
    path.write_bytes(path.read_bytes()[: offsets[2] + bytes_left])
    recover(tmp_path, "youtube")
    assert [
        entry.request.params["id"] for entry in rawlog.envelopes(tmp_path, "youtube", "videos")
    ] == [
        "v0",
        "v1",
        "v2",
    ]
    assert not list(path.parent.glob("*.open"))


def test_an_empty_open_segment_goes(tmp_path):
    folder = rawlog.folder(tmp_path, "youtube", "videos")
    folder.mkdir(parents=True)
    (folder / "000001-aaaaaaaa.ndjson.zst.open").write_bytes(b"")
    recover(tmp_path, "youtube")
    assert not list(folder.iterdir())


def test_segments_of_several_machines_are_read_as_one(tmp_path):
    for machine in ("a", "b"):
        written(tmp_path / machine, 2)
        for path in rawlog.segments(tmp_path / machine, "youtube", "videos"):
            place = rawlog.folder(tmp_path / "all", "youtube", "videos") / path.name
            place.parent.mkdir(parents=True, exist_ok=True)
            place.write_bytes(path.read_bytes())
    assert len(rawlog.segments(tmp_path / "all", "youtube", "videos")) == 2
    assert len(list(rawlog.envelopes(tmp_path / "all", "youtube", "videos"))) == 4


@pytest.mark.parametrize("place", ["middle", "end", "all"])
def test_readers_name_a_damaged_segment_behind_what_they_can_read(tmp_path, place):
    offsets = [0, *written(tmp_path, 4)]
    [path] = rawlog.segments(tmp_path, "youtube", "videos")
    first, last = {"middle": (1, 2), "end": (3, 4), "all": (0, 4)}[place]
    data = bytearray(path.read_bytes())
    data[offsets[first] : offsets[last]] = b"\xff" * (offsets[last] - offsets[first])
    path.write_bytes(data)
    read = []
    with pytest.raises(
        DamagedData, match=f"{path.name} is damaged at byte {offsets[first]}"
    ) as said:
        read.extend(
            entry.request.params["id"] for entry in rawlog.envelopes(tmp_path, "youtube", "videos")
        )
    assert read == [f"v{n}" for n in range(4) if not first <= n < last]
    assert "kb youtube crawl" in said.value.hint
    assert rawlog.any_answer(tmp_path, "youtube"), "what can't be read is not nothing"


def test_the_torn_tail_of_an_open_segment_is_no_damage(tmp_path):
    offsets = written(tmp_path, 2, close=False)
    [path] = rawlog.segments(tmp_path, "youtube", "videos")
    path.write_bytes(path.read_bytes()[: offsets[0] + 9])
    assert len(list(rawlog.envelopes(tmp_path, "youtube", "videos"))) == 1
    path.write_bytes(path.read_bytes()[: offsets[0] - 1])
    assert not rawlog.any_answer(tmp_path, "youtube")


def test_a_line_that_is_no_envelope_says_so():
    with pytest.raises(DamagedData, match="not an envelope"):
        rawlog.decode(b'{"fetched_at": 3}\n')


TEXT = some.text(some.characters(exclude_categories=()), max_size=40)
JSON = some.recursive(
    some.none() | some.booleans() | some.integers(-(2**53), 2**53) | TEXT,
    lambda inner: some.lists(inner, max_size=4) | some.dictionaries(TEXT, inner, max_size=4),
    max_leaves=12,
)


def held(value):
    if isinstance(value, str):
        return "".join(
            "\ufffd" if char == "\0" or "\ud800" <= char <= "\udfff" else char for char in value
        )
    if isinstance(value, dict):
        return {held(key): held(inner) for key, inner in value.items()}
    return [held(inner) for inner in value] if isinstance(value, list) else value


@given(JSON)
def test_answers_are_verbatim_but_for_what_text_cannot_hold(response):
    line = rawlog.encode(Envelope(None, Request("e", {}), 200, response))
    assert msgspec.json.decode(line)["response"] == held(response)


@given(
    some.lists(some.binary(min_size=1, max_size=3000), min_size=1, max_size=12),
    some.integers(0, 4000),
)
def test_whole_frames_of_any_prefix(tmp_path_factory, lines, cut):
    path = tmp_path_factory.mktemp("frames") / "segment"
    frames = [zstandard.ZstdCompressor().compress(line) for line in lines]
    data = b"".join(frames)
    cut = min(cut, len(data))
    path.write_bytes(data[: len(data) - cut])
    read = Frames(path, skip_damage=True)
    found = [line for _, line in read]
    whole = 0
    while sum(map(len, frames[: whole + 1])) <= len(data) - cut and whole < len(frames):
        whole += 1
    assert found == lines[:whole]
    assert read.good == sum(map(len, frames[:whole]))
    assert read.torn == (read.good < len(data) - cut)
