"""What dependencies would send by themselves is switched off here, before any of them is imported.

`kb/__init__.py` calls this, so it also holds in worker processes and where kb is used as a library.
Other switches stand where the thing is started: Chromium's in kb/wiki/browser/browser.py, Dask's
dashboard in kb/core/dask_engine.py, PRAW's question for updates in
kb/reddit/connector/client.py.
"""

from __future__ import annotations

import os

# Each is read when its library is imported, or by a program that it starts.
ENVIRONMENT = {
    "HF_HUB_DISABLE_TELEMETRY": "1",  # huggingface_hub, transformers, datasets
    "DO_NOT_TRACK": "1",  # the common wish; read by huggingface_hub too
    "SE_AVOID_STATS": "true",  # Selenium Manager's usage statistics
    # ONNX Runtime's reporter, which is in its builds for Linux too: read when it is imported, and
    # without it a device's number and a queue of events are written to the user's cache.
    "ORT_DISABLE_TELEMETRY": "1",
}


def switch_off() -> None:
    """Set the switches for this process and those that it starts."""
    os.environ |= ENVIRONMENT
