"""Single changed bits in raw segments and Parquet files: whether a reader of ours takes one for
what was written.

`python -m tests.store.flips ROOT COUNT [SEED]` tries COUNT of them over a data root.
"""

from __future__ import annotations

import random
import sys
import tempfile
from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import duckdb
import pyarrow as pa

from kb.core.errors import DamagedData
from kb.store import parquet, rawlog
from kb.store.reading import reading


def files(root: Path) -> list[Path]:
    """Raw segments and Parquet files of a data root, those in state/ left out."""
    found = [*root.glob(f"raw/*/*/*{rawlog.SUFFIX}"), *root.rglob("*.parquet")]
    return sorted(path for path in found if "state" not in path.relative_to(root).parts)


def read(path: Path) -> Any:
    """All that a file says, as the program reads it: lines of a segment, or a table by both ways.

    Raises DamagedData.
    """
    if not path.name.endswith(".parquet"):
        return [line for _, line in rawlog.Frames(path)]
    with reading([path]):
        assert parquet.footer(path).num_rows >= 0
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
    with tempfile.TemporaryDirectory() as scratch:
        for path, bit in flipped(found, count, seed):
            # A name of its own: a new file of the same name, size and time counts as checked.
            copy = Path(scratch, f"{counts.total()}-{path.name}")
            data = bytearray(path.read_bytes())
            data[bit // 8] ^= 1 << bit % 8
            copy.write_bytes(data)
            try:
                said = read(copy)
            except DamagedData:
                counts["told"] += 1
            else:
                if _same(said, whole[path]):
                    counts["no effect"] += 1
                else:
                    counts["silent"] += 1
                    silent.append(f"{path.name}: bit {bit}")
            copy.unlink()
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
