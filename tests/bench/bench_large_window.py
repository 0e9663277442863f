"""One dump of 2 GiB of content in a frame with a window of 2^31, as the archives' files have:
imported in less than 3 GiB of memory, on one worker and on two.

KB_BENCH_CONTENT=268435456 make bench ARGS="-k window"      fewer bytes, for a quick look
"""

import itertools
import json
import os
import sys
from pathlib import Path

import pytest
import zstandard

from tests.bench import measured

pytestmark = [pytest.mark.bench, pytest.mark.timeout(3600)]

CONTENT = int(os.environ.get("KB_BENCH_CONTENT", str(2 << 30)))
MEMORY = 3 << 10  # MiB
HERE = Path(__file__).resolve().parents[2]


def write(path: Path) -> int:
    """A monthly file whose frame needs a window of 2^31; how many records are Minecraft's."""
    pad = "".join(chr(97 + n * 7919 % 26) for n in range(600))
    engine = zstandard.ZstdCompressor(
        compression_params=zstandard.ZstdCompressionParameters.from_level(
            1, window_log=31, enable_ldm=False
        )
    )
    wanted, size = 0, 0
    with path.open("wb") as file, engine.stream_writer(file) as out:
        for number in itertools.count():
            ours = number % 200 == 7
            name, key = ("Minecraft", "t5_2r05i") if ours else ("gardening", "t5_2qhw1")
            record = {
                "id": f"c{number:07x}",
                "subreddit": name,
                "subreddit_id": key,
                "author": f"person{number % 977}",
                "link_id": f"t3_p{number % 5000:x}",
                "parent_id": f"t3_p{number % 5000:x}",
                "created_utc": 1_700_000_000 + number,
                "score": number % 90,
                "body": f"{number * 2654435761 % (1 << 61):x} {pad}",
            }
            line = json.dumps(record).encode() + b"\n"
            out.write(line)
            wanted, size = wanted + ours, size + len(line)
            if size >= CONTENT:
                return wanted
    raise AssertionError


def test_a_window_of_two_gigabytes(tmp_path: Path) -> None:
    dump = tmp_path / "RC_2024-01.zst"
    wanted = write(dump)
    window = zstandard.get_frame_parameters(dump.read_bytes()[:18]).window_size
    assert window == 1 << 31
    peaks = {}
    for workers in (1, 2):
        words = ["reddit", "import", str(dump), "--data", str(tmp_path / f"root{workers}")]
        command = [sys.executable, "-c", "from kb.cli import main; main()", *words]
        command += ["--workers", str(workers), "--quiet", "--json"]
        found = measured.run(command, {**os.environ, "PYTHONPATH": str(HERE)}, HERE)
        assert found.code == 0, found.said
        assert json.loads(found.said.splitlines()[-1])["crawled"] == wanted
        peaks[workers] = found.peak
        print(
            f"\n{CONTENT >> 20:,} MiB of content, window {window >> 20:,} MiB, {workers} workers:"
            f" peak {found.peak:,.0f} MiB, {found.cpu:.1f} CPU s, {found.wall:.1f} s"
        )
    assert max(peaks.values()) < MEMORY
