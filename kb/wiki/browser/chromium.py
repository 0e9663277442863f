"""Finds Chromium and its driver, and runs the driver.

We start the driver, not Selenium, so that we can end its whole process group.
"""

import os
import re
import select
import shutil
import subprocess
import tempfile
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from kb.core import clock
from kb.core.errors import MissingExtra
from kb.core.installation import install_extra
from kb.wiki.browser import process_guard

BROWSERS = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "chrome")
INSTALL = (
    "install them, e.g. `apt-get install chromium chromium-driver` (Debian), or run `make setup`"
)


@dataclass(frozen=True)
class Programs:
    """Paths of the two programs."""

    browser: str
    driver: str


def find() -> Programs:
    """The browser and a driver of the same major version. Raises MissingExtra (exit 2)."""
    try:
        import PIL  # noqa: F401
        import selenium  # noqa: F401
    except ImportError as error:
        raise MissingExtra(
            f"the wiki crawl needs the Python package {error.name}",
            hint=install_extra("wiki"),
        ) from None
    return _find(os.environ.get("PATH", os.defpath), os.environ.get("SE_CACHE_PATH", ""))


@cache
def _find(path: str, cache_path: str) -> Programs:
    browser = next((place for name in BROWSERS if (place := shutil.which(name, path=path))), None)
    driver = shutil.which("chromedriver", path=path)
    browser, driver = (
        browser or _fetched(cache_path, "chrome"),
        driver or _fetched(cache_path, "chromedriver"),
    )
    missing = [
        name for name, there in (("Chromium", browser), ("chromedriver", driver)) if not there
    ]
    if missing or not browser or not driver:
        raise MissingExtra(
            f"{' and '.join(missing)} not found; the wiki is read with a real browser", hint=INSTALL
        )
    versions = _version(browser), _version(driver)
    if versions[0].split(".")[0] != versions[1].split(".")[0]:
        raise MissingExtra(
            f"{driver} is version {versions[1]} and can't drive {browser} version {versions[0]}",
            hint=f"the two must have the same major version: {INSTALL}",
        )
    return Programs(browser, driver)


def _fetched(cache_path: str, name: str) -> str | None:
    """The program that Selenium Manager fetched during `make setup`; nothing is downloaded."""
    base = Path(cache_path or Path.home() / ".cache" / "selenium") / name
    installed = [file for file in base.glob(f"*/*/{name}") if os.access(file, os.X_OK)]

    def version(file: Path) -> list[int]:
        return [int(number) for number in re.findall(r"\d+", file.parent.name)]

    newest = max(installed, key=version, default=None)
    return None if newest is None else str(newest)


def _version(program: str) -> str:
    """The version that a program reports. Raises MissingExtra when it does not run."""
    try:
        done = subprocess.run(
            [program, "--version"], capture_output=True, text=True, timeout=60, check=False
        )
    except (OSError, subprocess.TimeoutExpired) as error:
        raise MissingExtra(f"{program} does not run: {error}", hint=INSTALL) from None
    match = re.search(r"\d+(?:\.\d+)+", done.stdout)
    if done.returncode or not match:
        output = (done.stderr or done.stdout).strip().splitlines()
        raise MissingExtra(
            f"{program} does not run: {output[-1] if output else f'exit {done.returncode}'}",
            hint=INSTALL,
        )
    return match[0]


START_SECONDS = 30
STARTS = 3  # attempts before a driver counts as broken
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
            # The driver picks a free port and exits when another program takes it first.
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
    """The port that the driver reports; None when it reports none."""
    assert process.stdout is not None
    end, output = clock.monotonic() + START_SECONDS, b""
    while clock.monotonic() < end:
        if not select.select([process.stdout], [], [], 1)[0]:
            continue
        part = os.read(process.stdout.fileno(), 4096)
        output += part
        if match := re.search(rb"successfully on port (\d+)", output):
            return int(match[1])
        if not part:
            break
    return None
