"""What a process sets when it starts: no telemetry of dependencies, memory that is kept for reuse,
and less garbage collection.

`kb/__init__.py` sets ENVIRONMENT before any dependency is imported, so it also holds in worker
processes and where kb is used as a library. Other switches are where the thing is started:
Chromium's in kb/wiki/browser/, the dashboard of Dask in kb/core/dask_engine.py, PRAW's check for
updates in kb/reddit/crawl/client.py.
"""

import gc

# Each is read when its library is imported, or by a program that it starts.
ENVIRONMENT = {
    "HF_HUB_DISABLE_TELEMETRY": "1",  # huggingface_hub, transformers, datasets
    "DO_NOT_TRACK": "1",  # the common wish; read by huggingface_hub too
    "SE_AVOID_STATS": "true",  # Selenium Manager's usage statistics
    # ONNX Runtime's reporter, which is in its builds for Linux too: read when it is imported, and
    # without it a device's number and a queue of events are written to the user's cache.
    "ORT_DISABLE_TELEMETRY": "1",
}


def collect_seldom() -> None:
    """Look for reference cycles after 20,000 new objects instead of 700.

    Imports create thousands of objects that stay, and few of ours form cycles: this saves a tenth
    of a command's start and of a report.
    """
    gc.set_threshold(20_000, 20, 20)
