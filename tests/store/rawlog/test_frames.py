"""Tests of `kb.store.rawlog.frames`."""

import zstandard
from hypothesis import given
from hypothesis import strategies as some

from kb.store.rawlog.rawlog import Frames


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
    read = Frames(path, mending=True)
    found = [line for _, line in read]
    whole = 0
    while sum(map(len, frames[: whole + 1])) <= len(data) - cut and whole < len(frames):
        whole += 1
    assert found == lines[:whole]
    assert read.good == sum(map(len, frames[:whole]))
    assert read.torn == (read.good < len(data) - cut)
