"""Video ids from a file, and the share of one machine of several."""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Callable
from pathlib import Path

import pyarrow.parquet as pq

from kb.core.errors import SettingError
from kb.store import parquet

Part = tuple[int, int] | None
"""Which of how many machines, from 1; None for one that does it all."""

_ID = re.compile(r"(?:^|[=/])([A-Za-z0-9_-]{11})(?:$|[?&#])")


def read_ids(path: Path) -> tuple[list[str], int]:
    """(ids in the file's order without duplicates, lines without one).

    Lines (ids or addresses), a Parquet file with `video_id`, MineDojo's JSON (objects with `id`),
    or the folder of a release. Raises SettingError.
    """
    try:
        if path.is_dir():
            values = [key for shard in released_shards(path) for key in _parquet(shard)]
        elif path.suffix == ".parquet":
            values = _parquet(path)
        elif path.suffix == ".json":
            values = _minedojo(path)
        else:
            values = [
                line.strip()
                for line in path.read_text(encoding="utf-8-sig").splitlines()
                if line.strip()
            ]
    except OSError as error:
        raise SettingError(f"--ids {path}: {error.strerror or error}") from None
    except (ValueError, RecursionError) as error:
        raise SettingError(f"--ids {path} can't be read: {str(error).splitlines()[0]}") from None
    ids = [match[1] if (match := _ID.search(value)) else None for value in values]
    return list(dict.fromkeys(key for key in ids if key)), ids.count(None)


def some_ids(path: Path) -> tuple[list[str], int]:
    """The same for a crawl, which has nothing to do without one. Raises SettingError also when
    there is none.
    """
    ids, bad_lines = read_ids(path)
    if not ids:
        raise SettingError(
            f"--ids {path} holds no video id",
            hint="write one a line: 11 characters, or a video's address",
        )
    return ids, bad_lines


def released_shards(folder: Path) -> list[Path]:
    """The shards of a release that name videos: its `videos`, else its `pairs`."""
    for name in ("videos", "pairs"):
        if shards := sorted(folder.glob(f"{name}-*-of-*.parquet")):
            return shards
    raise SettingError(
        f"--ids {folder} holds no released videos or pairs",
        hint="name the folder of a release, as in `--ids release/youtube`, or a file",
    )


def _parquet(path: Path) -> list[str]:
    names = pq.read_schema(path).names
    column = next((name for name in ("video_id", "id", "key") if name in names), None)
    if column is None:
        raise SettingError(f"--ids {path} has no column video_id; it has {', '.join(names)}")
    return [str(value) for value in parquet.read_table(path, columns=[column])[column].to_pylist()]


def _minedojo(path: Path) -> list[str]:
    data = json.loads(path.read_text(encoding="utf-8-sig"))
    if not isinstance(data, list):
        raise SettingError(
            f"--ids {path} is no list", hint="MineDojo's files are lists of objects with an id"
        )
    return [str(entry.get("id", "")) if isinstance(entry, dict) else str(entry) for entry in data]


def share(part: Part) -> Callable[[str], bool]:
    """Whether a key belongs to the part: the same on every machine, and every key to one."""
    if part is None:
        return lambda key: True
    number, count = part

    def mine(key: str) -> bool:
        return (
            int.from_bytes(hashlib.sha256(key.encode()).digest()[:8], "big") % count == number - 1
        )

    return mine
