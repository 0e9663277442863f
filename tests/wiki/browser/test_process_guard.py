"""No browser outlives the process that started it."""

import shutil
import signal
import subprocess
import sys
import threading

import psutil

from kb.wiki.browser.chromium import Programs

ALONE = """
import sys, threading
from kb.wiki.browser import chromium
from kb.wiki.browser.browser import Browser
from kb.wiki.browser.pool import Pool

pool = Pool(lambda watcher: Browser(chromium.find(), watcher, hosts=[], origins=[],
    user_agent="lorecrawl/test (+test@example.org)", viewport=(400, 300), page_seconds=60), 60)
started = []
thread = threading.Thread(target=lambda: started.append(pool._new()))
thread.start()
thread.join()
assert started[0].script("return 1 + 1") == 2
print(pool._guard._process.pid, *(browser.process.pid for browser in pool._all), flush=True)
sys.stdin.read()
"""


def test_no_browser_outlives_us_and_its_guard(programs: Programs) -> None:
    """Both are killed at once; a browser that was started by a thread that has ended works."""
    ours = subprocess.Popen(
        [sys.executable, "-c", ALONE], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    )
    assert ours.stdout is not None
    try:
        watcher, *drivers = (psutil.Process(int(pid)) for pid in ours.stdout.readline().split())
        left = [one for driver in drivers for one in (driver, *driver.children(recursive=True))]
        folders = [one.environ()["HOME"] for one in drivers]
        assert len(left) > 2 * 3
        ours.send_signal(signal.SIGSTOP)  # so that it sees nothing of its guard's end
        watcher.kill()
    finally:
        ours.kill()
        ours.communicate()
    ended(left)
    for folder in folders:
        shutil.rmtree(folder)


def ended(processes: list[psutil.Process]) -> None:
    """Wait until they have ended; those that nobody asks for their end count too."""
    for _ in range(1200):
        alive = [one for one in processes if lives(one)]
        if not alive:
            return
        threading.Event().wait(0.05)
    for one in alive:
        one.kill()
    raise AssertionError(f"left behind: {alive}")


def lives(process: psutil.Process) -> bool:
    """Whether it runs."""
    try:
        return process.is_running() and process.status() != "zombie"
    except psutil.NoSuchProcess:
        return False
