"""What dependencies would send by themselves is switched off here, before any of them is imported.

`kb/__init__.py` calls this, so it also holds in worker processes and where kb is used as a library.
Other switches stand where the thing is started: Chromium's in kb/wiki/browser.py, Dask's dashboard
in kb/core/dask_engine.py, PRAW's question for updates in kb/reddit/client.py.
"""

from __future__ import annotations

import os
import sys

# Each is read when its library is imported, or by a program that it starts.
ENVIRONMENT = {
    "HF_HUB_DISABLE_TELEMETRY": "1",  # huggingface_hub, transformers, datasets
    "DO_NOT_TRACK": "1",  # the common wish; read by huggingface_hub too
    "SE_AVOID_STATS": "true",  # Selenium Manager's usage statistics
    # ONNX Runtime's reporter, which is in its builds for Linux too: read when it is imported, and
    # without it a device's number and a queue of events are written to the user's cache.
    "ORT_DISABLE_TELEMETRY": "1",
}
# Reporters that a library uses when they can be imported and does without when they can't.
# openvino-telemetry asks a file in the user's home folder whether it may report, and reports
# where there is none.
REPORTERS = ("openvino_telemetry",)


def switch_off() -> None:
    """Set the switches for this process and those that it starts."""
    os.environ |= ENVIRONMENT
    for name in REPORTERS:
        # None makes `import` fail as if the package were not there (documented for sys.modules).
        sys.modules[name] = None  # type: ignore[assignment]
