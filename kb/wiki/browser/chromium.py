"""Finds Chromium and its driver, runs the driver, and ends all processes of the browser.

A browser consists of many processes, and killing its driver alone leaves the others running. Each
driver therefore leads its own session, and the whole session with all descendants is ended. If this
process is killed, Linux kills the driver, and the browser exits because the pipe of its driver
closes.
"""

import contextlib
import os
import re
import select
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from kb.core import clock
from kb.core.errors import MissingExtra, SettingError
from kb.core.installation import install_extra
from kb.net.certificates import authorities

BROWSERS = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "chrome")
INSTALL = (
    "install them, e.g. `apt-get install chromium chromium-driver` (Debian), or run `make setup`"
)


@dataclass(frozen=True)
class Programs:
    """Paths of the two programs."""

    browser: str
    driver: str


def find_programs() -> Programs:
    """The browser and a driver of the same major version. Raises MissingExtra (exit 2)."""
    try:
        import PIL  # noqa: F401
        import psutil  # noqa: F401
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


# Becomes the driver, which Linux kills with us (PR_SET_PDEATHSIG of prctl(2), SIGKILL).
_RUN = """
import ctypes, os, sys
try:
    ctypes.CDLL(None).prctl(1, 9, 0, 0, 0)
except (OSError, AttributeError):
    pass
if os.getppid() == int(sys.argv[1]):
    os.execv(sys.argv[2], sys.argv[2:])
"""
START_SECONDS = 30
STARTS = 3  # attempts before a driver counts as broken
_READY = re.compile(rb"successfully on port (\d+)")
_FOLDER = "lorecrawl-browser-"  # followed by our process id
_KEPT = ("PATH", "LD_LIBRARY_PATH", "FONTCONFIG_FILE", "FONTCONFIG_PATH")


def _certificates() -> list[str]:
    """The folders of authorities besides Chromium's own, which it looks for below the home."""
    stores = (".pki/nssdb", ".local/share/pki/nssdb")
    return [store for store in stores if (Path.home() / store).is_dir()]


class DriverProcess:
    """A running driver: `port` on loopback, `folder` is its home. `end` it."""

    def __init__(self, program: str) -> None:
        """Raises MissingExtra when it does not start."""
        import psutil

        for leftover in Path(tempfile.gettempdir()).glob(f"{_FOLDER}*"):  # of killed processes
            if not psutil.pid_exists(int(leftover.name.split("-")[2])):
                shutil.rmtree(leftover, ignore_errors=True)
        self.folder = tempfile.mkdtemp(prefix=f"{_FOLDER}{os.getpid()}-")
        names = ("HOME", "TMPDIR", "XDG_CONFIG_HOME", "XDG_CACHE_HOME")
        for store in _certificates():
            shutil.copytree(Path.home() / store, Path(self.folder, store))
        env = {name: os.environ[name] for name in _KEPT if name in os.environ}
        env |= {"LANG": "C.UTF-8", "TZ": "UTC", **dict.fromkeys(names, self.folder)}
        # The driver picks a free port and exits when another program takes it first.
        for _ in range(STARTS):
            try:
                starting = _starter(os.getpid()).submit(
                    subprocess.Popen[bytes],
                    [sys.executable, "-I", "-S", "-c", _RUN, str(os.getpid()), program, "--port=0"],
                    stdin=subprocess.DEVNULL,
                    stdout=subprocess.PIPE,
                    stderr=subprocess.DEVNULL,
                    start_new_session=True,
                    env=env,
                    cwd=self.folder,
                )
                self._process = starting.result()
            except OSError as error:
                raise MissingExtra(f"{program} does not start: {error}", hint=INSTALL) from None
            output = _output(self._process)
            if port := _READY.search(output):
                self.port = int(port[1])
                return
            self.kill()
            code = self._process.wait()
        shutil.rmtree(self.folder, ignore_errors=True)
        lines = output.decode(errors="replace").strip().splitlines()
        reason = lines[-1] if lines else f"exit {code}"
        raise MissingExtra(f"{program} does not start: {reason}", hint=INSTALL)

    @property
    def pid(self) -> int:
        """The leader of its process group."""
        return self._process.pid

    def kill(self) -> None:
        """End its processes at once; `end` cleans up."""
        end(self._process.pid)

    def end(self) -> None:
        """End its processes and remove the folder."""
        end(self._process.pid, self.folder)
        self._process.wait()
        if self._process.stdout:
            self._process.stdout.close()


def _output(process: subprocess.Popen[bytes]) -> bytes:
    """What the driver prints until it is ready, ends or START_SECONDS have passed."""
    assert process.stdout is not None
    end, output = clock.monotonic() + START_SECONDS, b""
    while clock.monotonic() < end and not _READY.search(output):
        if not select.select([process.stdout], [], [], 1)[0]:
            continue
        part = os.read(process.stdout.fileno(), 4096)
        output += part
        if not part:
            break
    return output


@cache
def _starter(pid: int) -> ThreadPoolExecutor:
    """A thread that lasts as long as the process `pid`, as Linux kills a driver with the thread
    that started it.
    """
    return ThreadPoolExecutor(1, thread_name_prefix=f"starter-{pid}")


def family(leader: int, folder: str = "") -> list[int]:
    """All processes of the session of `leader`, its descendants, and those that name its folder.

    Chromium's crash handler leaves session and parents at once; the folder in its arguments gives
    it away. A zombie that waits for its parent counts as gone.
    """
    import psutil

    parents: dict[int, int] = {}
    family = {leader}
    for process in psutil.process_iter():
        with contextlib.suppress(psutil.Error, OSError):
            if process.status() == psutil.STATUS_ZOMBIE:
                continue
            parents[process.pid] = process.ppid()
            named = folder and any(folder in argument for argument in process.cmdline())
            if named or os.getsid(process.pid) == leader:
                family.add(process.pid)
    while more := {pid for pid, parent in parents.items() if parent in family} - family:
        family |= more
    return sorted(family & parents.keys())


def end(leader: int, folder: str = "") -> None:
    """Kill the family of `leader` until none is left, then remove its folder."""
    for _ in range(50):
        if not (alive := family(leader, folder)):
            break
        for pid in alive:
            with contextlib.suppress(OSError):
                os.kill(pid, signal.SIGKILL)
        threading.Event().wait(0.02)
    if folder:
        shutil.rmtree(folder, ignore_errors=True)


def requirements() -> Iterator[tuple[str, str, str, str]]:
    """What a crawl of a wiki needs of this machine, for `kb doctor`: the browser with its driver,
    and that it trusts whom the other clients trust.
    """
    try:
        programs = find_programs()
        yield "ok", "browser", f"{programs.browser} with {programs.driver}", ""
    except MissingExtra as error:
        yield "problem", "browser", str(error), error.hint
    try:
        _, own_authorities = authorities()
    except SettingError:  # which is said of the other clients
        return
    if own_authorities and not _certificates():
        what = "it trusts the usual authorities alone"
        fix = "if your company signs certificates, add its authority (docs/long-crawls.md)"
        yield "note", "browser's certificates", what, fix
