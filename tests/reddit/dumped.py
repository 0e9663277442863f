"""Dumps by hand, and what an import made of them."""

import gzip
import json
import random
import struct
from pathlib import Path
from typing import Any

import zstandard

from kb.core.config.profile import load_profile
from kb.core.config.settings import load_settings
from kb.core.context import Run
from kb.reddit.parse import answers as parse
from kb.store.rawlog import rawlog


def run_in(root, **options):
    return Run(
        load_settings(dotenv=False), load_profile("minecraft"), root, **{"workers": 1, **options}
    )


def post(key, **fields):
    return {
        "id": key,
        "subreddit": "Minecraft",
        "author": "brisk_otter",
        "title": f"post {key}",
        "selftext": "",
        "is_self": True,
        "over_18": False,
        "score": 7,
        "created_utc": 1_600_000_000,
        "retrieved_on": 1_600_100_000,
        **fields,
    }


def comment(key, **fields):
    return {
        "id": key,
        "subreddit": "Minecraft",
        "author": "brisk_otter",
        "body": f"comment {key}",
        "link_id": "t3_a",
        "parent_id": "t3_a",
        "score": 7,
        "created_utc": 1_600_000_000,
        **fields,
    }


def write(path, lines, frames=1, cut=0):
    """A dump of JSON objects and bytes, in so many frames; `cut` bytes are missing at its end."""
    texts = [line if isinstance(line, bytes) else json.dumps(line).encode() for line in lines]
    size = max(1, -(-len(texts) // frames))
    data = b"".join(
        zstandard.ZstdCompressor().compress(b"\n".join(texts[n : n + size]) + b"\n")
        for n in range(0, len(texts), size)
    )
    path.write_bytes(data[: len(data) - cut])
    return path


def imported(root):
    """Every thing in the raw log, as (kind, data)."""
    return [
        (thing["kind"], thing["data"])
        for envelope in rawlog.envelopes(root, "reddit", "dumps")
        for thing in envelope.response["data"]["children"]
    ]


_IMPORT = """
import sys
from kb.reddit.crawl.importer import import_dumps
from kb.reddit.dumps.import_file import ImportJob, import_file
import_file(ImportJob(sys.argv[2], sys.argv[1], "Minecraft", 0.0, float("inf"), 0, 60_000))
"""


def zstd(data: bytes) -> bytes:
    """Two frames."""
    half = data.find(b"\n", len(data) // 2) + 1
    return b"".join(map(frame, filter(None, (data[:half], data[half:]))))


def frame(data: bytes) -> bytes:
    """With a checksum, as `zstd` writes it."""
    return zstandard.ZstdCompressor(write_checksum=True).compress(data)


def members(data: bytes) -> bytes:
    """Two members, the first of which ends in the middle of a line."""
    half = len(data) // 2
    return gzip.compress(data[:half]) + gzip.compress(data[half:])


def blocks(data: bytes, rows: int = 100) -> bytes:
    lines = data.splitlines()
    return b"".join(block(lines[at : at + rows]) for at in range(0, len(lines), rows))


def block(rows: list[bytes]) -> bytes:
    at, table = 0, [len(rows)]
    for row in rows:
        table += [at, len(row)]
        at += len(row)
    made = frame(struct.pack(f"<{len(table)}I", *table) + b"".join(rows))
    return struct.pack("<I", len(made)) + made


def records(number: int, size: int = 40) -> list[dict[str, Any]]:
    chance = random.Random(number).randbytes(size * number)
    return [
        post(
            f"p{n:05d}",
            selftext=chance[n * size : (n + 1) * size].hex(),
            subreddit="Minecraft" if n % 3 else "gardening",
        )
        for n in range(number)
    ]


def imported_rows(root):
    """The rows of an import, with `fetched_at` as text."""
    links = load_profile("minecraft").reddit.links
    lines = map(rawlog.encode, rawlog.envelopes(root, "reddit", "dumps"))
    found = [row for part in parse.rows(lines, "dumps", links) for row in part.to_pylist()]
    for row in found:
        row["fetched_at"] = row["fetched_at"] and f"{row['fetched_at']:%Y-%m-%dT%H:%M:%SZ}"
    return found


def archived(path: Path, *keys: str) -> Path:
    """A dump with a window of 2^31 bytes, as the archives make them: one block as it is."""
    content = b"".join(json.dumps(post(key)).encode() + b"\n" for key in keys)
    header = b"\x28\xb5\x2f\xfd" + bytes([0, (31 - 10) << 3])
    path.write_bytes(header + ((len(content) << 3) | 1).to_bytes(3, "little") + content)
    return path
