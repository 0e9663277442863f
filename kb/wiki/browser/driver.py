"""The process of a chromedriver, with the home folder of its browser.

It is started by us, not by Selenium, so that its process group is ours to end.
"""

from __future__ import annotations

import os
import re
import select
import shutil
import subprocess
import tempfile

from kb.core import clock
from kb.core.errors import MissingExtra
from kb.wiki.browser import process_guard
from kb.wiki.browser.chromium import INSTALL

START_SECONDS = 30
STARTS = 3  # before a driver counts as one that doesn't start
_KEPT = ("PATH", "LD_LIBRARY_PATH", "FONTCONFIG_FILE", "FONTCONFIG_PATH")


class DriverProcess:
    """A running driver: `port` on loopback, `folder` is its home. `end` it."""

    def __init__(self, program: str, watcher: process_guard.Guard) -> None:
        """Raises MissingExtra when it does not start."""
        self.folder = tempfile.mkdtemp(prefix="lorecrawl-browser-")
        self._watcher = watcher
        self.port = self._listening(program)

    @property
    def pid(self) -> int:
        """The leader of its process group."""
        return self._process.pid

    def kill(self) -> None:
        """End its processes at once; `end` cleans up."""
        process_guard.end(self._process.pid)

    def end(self) -> None:
        """End its processes and remove the folder."""
        process_guard.end(self._process.pid, self.folder)
        self._ended()

    def _listening(self, program: str) -> int:
        for _ in range(STARTS):
            self._process = self._start(program)
            self._watcher.watch(self._process.pid, self.folder)
            port = _port(self._process)
            if port is not None:
                return port
            # It takes a free port, and ends when another program was faster.
            self.kill()
            self._ended()
        shutil.rmtree(self.folder, ignore_errors=True)
        raise MissingExtra(f"{program} does not start", hint=INSTALL)

    def _start(self, program: str) -> subprocess.Popen[bytes]:
        kept = {name: os.environ[name] for name in _KEPT if name in os.environ}
        home = {
            "HOME": self.folder,
            "TMPDIR": self.folder,
            "XDG_CONFIG_HOME": self.folder,
            "XDG_CACHE_HOME": self.folder,
            "LANG": "C.UTF-8",
            "TZ": "UTC",
        }
        try:
            return process_guard.start([program, "--port=0"], {**kept, **home}, self.folder)
        except OSError as error:
            raise MissingExtra(f"{program} does not start: {error}", hint=INSTALL) from None

    def _ended(self) -> None:
        self._process.wait()
        if self._process.stdout:
            self._process.stdout.close()
        self._watcher.forget(self._process.pid)


def _port(process: subprocess.Popen[bytes]) -> int | None:
    """The port that the driver says it listens on; None when it says none."""
    assert process.stdout is not None
    end, said = clock.monotonic() + START_SECONDS, b""
    while clock.monotonic() < end:
        if not select.select([process.stdout], [], [], 1)[0]:
            continue
        part = os.read(process.stdout.fileno(), 4096)
        said += part
        if match := re.search(rb"successfully on port (\d+)", said):
            return int(match[1])
        if not part:
            break
    return None
