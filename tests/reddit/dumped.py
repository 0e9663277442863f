"""Dumps by hand, and what an import made of them."""

import json
import signal
import time

import zstandard

from kb.core.config.profile import load_profile
from kb.core.config.settings import load_settings
from kb.core.context import Run
from kb.reddit.dumps.import_file import ImportJob, import_file
from kb.store.rawlog import rawlog
from tests import processes


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
        for envelope in rawlog.read(root, "reddit", "dumps")
        for thing in envelope.response["data"]["children"]
    ]


_IMPORT = """
import sys
from kb.reddit.dumps.import_file import ImportJob, import_file
import_file(ImportJob(sys.argv[2], sys.argv[1], "Minecraft", 0.0, float("inf"), 0, 60_000))
"""


def import_killed(root, dump, segments):
    """Import a dump, killed each time that there are so many `segments`, then to its end."""
    folder = rawlog.folder(root, "reddit", "dumps")
    for number in segments:
        child = processes.program(_IMPORT, dump, root)
        while child.poll() is None and len(list(folder.glob("*.zst"))) < number:
            time.sleep(0.001)
        child.send_signal(signal.SIGKILL)
        assert child.wait() in (0, -signal.SIGKILL), child.output()
    job = ImportJob(str(root), str(dump), "Minecraft", 0.0, float("inf"), 0, 60_000)
    assert import_file(job).done
