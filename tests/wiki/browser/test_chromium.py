"""Tests of the browser programs: drivers that do not start, processes that must end."""

import subprocess
import sys
import threading
from collections.abc import Callable
from pathlib import Path

import psutil
import pytest

from kb.core.errors import MissingExtra, Retryable
from kb.wiki.browser.browser import Browser, Pool
from kb.wiki.browser.chromium import STARTS, DriverProcess, Programs


@pytest.fixture
def start(programs: Programs, tmp_path: Path) -> Callable[[int], Callable[..., Browser]]:
    """start(n): starts a browser whose driver ends at its first n starts, as chromedriver does when
    its port is taken.
    """

    def make(failures: int) -> Callable[..., Browser]:
        driver, count = tmp_path / "driver", tmp_path / "count"
        count.write_text("")
        driver.write_text(
            f'#!/bin/sh\nprintf x >> "{count}"\n[ $(wc -c < "{count}") -gt {failures} ] ||'
            f' exit 1\nexec "{programs.driver}" "$@"\n'
        )
        driver.chmod(0o755)
        return lambda: Browser(
            Programs(programs.browser, str(driver)),
            hosts=["127.0.0.1"],
            origins=["http://127.0.0.1"],
            user_agent="lorecrawl/test (+test@example.org)",
            viewport=(400, 300),
            page_seconds=60,
        )

    return make


def test_a_driver_whose_port_was_taken_is_started_again(
    start: Callable[[int], Callable[..., Browser]],
) -> None:
    with Pool(start(1), 60) as pool:
        assert pool.use(lambda browser: browser.script("return 1 + 1")) == 2


def test_a_driver_that_never_starts_is_missing(
    start: Callable[[int], Callable[..., Browser]],
) -> None:
    with pytest.raises(MissingExtra, match="driver does not start: exit 1"):
        Pool(start(STARTS), 60)


def test_a_later_browser_that_does_not_start_costs_a_try_and_not_the_run(
    start: Callable[[int], Callable[..., Browser]],
) -> None:
    make = start(0)
    with Pool(make, 60) as pool:
        start(STARTS)
        with pytest.raises(Retryable, match="browser_start"):
            pool.use(lambda browser: pool.use(lambda other: None))


ALONE = """
import sys, threading
from kb.wiki.browser import chromium
from kb.wiki.browser.browser import Browser
from kb.wiki.browser.browser import Pool

pool = Pool(lambda: Browser(chromium.find_programs(), hosts=[], origins=[],
    user_agent="lorecrawl/test (+test@example.org)", viewport=(400, 300), page_seconds=60), 60)
started = []
thread = threading.Thread(target=lambda: started.append(pool._new()))
thread.start()
thread.join()
assert started[0].script("return 1 + 1") == 2
print(*(browser.process.pid for browser in pool._all), flush=True)
sys.stdin.read()
"""


def test_no_browser_outlives_us(programs: Programs) -> None:
    """A browser whose starting thread has ended works until this process is killed."""
    ours = subprocess.Popen(
        [sys.executable, "-c", ALONE], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    )
    assert ours.stdout is not None
    try:
        drivers = [psutil.Process(int(pid)) for pid in ours.stdout.readline().split()]
        left = [one for driver in drivers for one in (driver, *driver.children(recursive=True))]
        folders = [Path(one.environ()["HOME"]) for one in drivers]
        assert len(left) > 2 * 3
    finally:
        ours.kill()
        ours.communicate()
    ended(left)
    DriverProcess(programs.driver).end()
    assert not any(folder.exists() for folder in folders), "the next browser removes them"


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
