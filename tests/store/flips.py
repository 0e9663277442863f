"""Single changed bits in raw segments and Parquet files: whether a reader of ours takes one for
what was written.

`python -m tests.store.flips ROOT COUNT [SEED]` tries COUNT of them over a data root.
"""

import os
import random
import sys
from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import duckdb
import pyarrow as pa
import pyarrow.parquet as pq

from kb.core.errors import DamagedData
from kb.store.rawlog import rawlog
from kb.store.tables import checksums, parquet
from kb.store.tables.reading import reading


def files(root: Path) -> list[Path]:
    """Raw segments of a data root, and the Parquet files that a manifest has digests of."""
    tables = [path for path in root.rglob("*.parquet") if checksums.recorded(path) is not None]
    return sorted([*root.glob(f"raw/*/*/*{rawlog.SUFFIX}"), *tables])


def read(path: Path) -> Any:
    """All that a file says, as the program reads it: lines of a segment, or a table by both ways.

    Raises DamagedData.
    """
    if not path.name.endswith(".parquet"):
        return [line for _, line in rawlog.Frames(path)]
    with reading([path]):
        assert pq.read_metadata(path).num_rows >= 0
        rows = parquet.read_table(path)
        with duckdb.connect() as con:
            same = con.sql("FROM read_parquet($file)", params={"file": str(path)}).to_arrow_table()
    return rows, same


def flipped(found: Sequence[Path], count: int, seed: int) -> Iterator[tuple[Path, int]]:
    """(file, number of the bit), each file as often."""
    draw = random.Random(seed)
    for number in range(count):
        path = found[number % len(found)]
        yield path, draw.randrange(path.stat().st_size * 8)


def tried(found: Sequence[Path], count: int, seed: int = 14) -> tuple[Counter[str], list[str]]:
    """How many were "told" and how many had "no effect", and a line for each silent one."""
    whole = {path: read(path) for path in found}
    counts: Counter[str] = Counter()
    silent = []
    for path, bit in flipped(found, count, seed):
        intact = path.read_bytes()
        data = bytearray(intact)
        data[bit // 8] ^= 1 << bit % 8
        path.write_bytes(data)
        # A file of the same size and time counts as verified.
        os.utime(path, ns=(0, 1_000_000_000 + counts.total()))
        try:
            said = read(path)
        except DamagedData:
            counts["told"] += 1
        else:
            if _same(said, whole[path]):
                counts["no effect"] += 1
            else:
                counts["silent"] += 1
                silent.append(f"{path.name}: bit {bit}")
        finally:
            path.write_bytes(intact)
    return counts, silent


def _same(one: Any, other: Any) -> bool:
    if isinstance(one, list):
        return bool(one == other)
    pairs: Iterator[tuple[pa.Table, pa.Table]] = zip(one, other, strict=True)
    return all(mine.equals(theirs) for mine, theirs in pairs)


def main(root: Path, count: int, seed: int = 14) -> int:
    """0 when none was silent."""
    counts, silent = tried(files(root), count, seed)
    print(", ".join(f"{number} {what}" for what, number in sorted(counts.items())))
    print("\n".join(silent))
    return int(bool(silent))


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1]), *map(int, sys.argv[2:])))
