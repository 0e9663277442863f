"""Tests of `kb.store.tables.partition`."""

import zlib
from pathlib import Path

import pyarrow as pa

from kb.store.tables.partition import Shuffle


def test_rows_of_a_key_meet_in_one_bucket_in_their_order(tmp_path: Path) -> None:
    keys = [f"k{n % 37}" if n % 11 else None for n in range(500)]
    rows = pa.table({"key": pa.array(keys, pa.string()), "n": range(500)})
    with Shuffle(tmp_path, "x", 8) as shuffle:
        for start in range(0, 500, 90):
            part = rows.slice(start, 90)
            shuffle.add_rows(part, part["key"])
    found = 0
    for path in tmp_path.glob("*/x.arrow"):
        with pa.ipc.open_file(str(path)) as file:
            part = file.read_all().to_pydict()
        assert part["n"] == sorted(part["n"])
        found += len(part["n"])
        # The same hash on every machine, so workers of a cluster agree.
        numbers = {zlib.crc32((key or "None").encode()) % 8 for key in part["key"]}
        assert numbers == {int(path.parent.name)}
    assert found == 500
