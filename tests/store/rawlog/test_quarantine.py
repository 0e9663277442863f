"""Tests of `kb.store.rawlog.quarantine`."""

import pytest
import zstandard

from kb.store.rawlog import quarantine, rawlog
from tests.store.rawlog.test_rawlog import written


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
