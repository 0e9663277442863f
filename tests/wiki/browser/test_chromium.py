"""Tests of the browser programs: what happens when one does not start."""

from collections.abc import Callable
from pathlib import Path

import pytest

from kb.core.errors import MissingExtra, Retryable
from kb.wiki.browser.browser import Browser
from kb.wiki.browser.chromium import STARTS, Programs
from kb.wiki.browser.pool import Pool


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
        return lambda watcher: Browser(
            Programs(programs.browser, str(driver)),
            watcher,
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
    with Pool(start(STARTS - 1), 60) as pool:
        assert pool.use(lambda browser: browser.script("return 1 + 1")) == 2


def test_a_driver_that_never_starts_is_missing(
    start: Callable[[int], Callable[..., Browser]],
) -> None:
    with pytest.raises(MissingExtra, match="driver does not start"):
        Pool(start(STARTS), 60)


def test_a_later_browser_that_does_not_start_costs_a_try_and_not_the_run(
    start: Callable[[int], Callable[..., Browser]],
) -> None:
    make = start(0)
    with Pool(make, 60) as pool:
        start(STARTS)
        with pytest.raises(Retryable, match="browser_start"):
            pool.use(lambda browser: pool.use(lambda other: None))
