"""The page in the real browser: on a phone and on a desk, without any request or error."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from selenium import webdriver
from selenium.webdriver.chrome.service import Service

from kb.core.errors import MissingExtra
from kb.wiki.browser import chromium
from tests.conftest import skip_or_fail

SIZES = {"phone": (390, 844, True), "small phone": (320, 640, True), "desk": (1280, 900, False)}


@pytest.fixture
def page(root: Path) -> Path:
    return root / "report" / "index.html"


class Running(Service):
    """The driver that runs already. Selenium itself would choose a port that another program may
    take before the driver does.
    """

    def start(self) -> None:
        """It has started."""

    def stop(self) -> None:
        """Whoever started it ends it."""


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    try:
        programs = chromium.find()
    except MissingExtra as error:
        skip_or_fail(str(error))
    options = webdriver.ChromeOptions()
    options.binary_location = programs.browser
    for flag in (
        *("--headless=new", "--no-sandbox", "--disable-gpu", "--disable-dev-shm-usage"),
        "--remote-debugging-pipe",  # it ends with its driver
    ):
        options.add_argument(flag)
    options.set_capability("goog:loggingPrefs", {"browser": "ALL", "performance": "ALL"})
    process = chromium.DriverProcess(programs.driver)
    try:
        yield webdriver.Chrome(options=options, service=Running(programs.driver, process.port))
    finally:
        process.end()


@pytest.mark.parametrize("name", SIZES)
def test_readable_without_scrolling_sideways(browser: Any, page: Path, name: str) -> None:
    width, height, mobile = SIZES[name]
    browser.execute_cdp_cmd(
        "Emulation.setDeviceMetricsOverride",
        {"width": width, "height": height, "deviceScaleFactor": 1, "mobile": mobile},
    )
    browser.get(page.as_uri())
    assert browser.execute_script(
        "return document.documentElement.scrollWidth <= window.innerWidth"
    )
    pictures = browser.execute_script(
        "return [...document.querySelectorAll('figure > img, figure > svg')].map(i =>"
        " [i.complete ?? true, i.naturalWidth || i.viewBox.baseVal.width * 96 / 72,"
        " i.getBoundingClientRect().width,"
        " (i.alt || i.ariaLabel).length, i.parentElement.id])"
    )
    assert len(pictures) == len([*page.parent.glob("*.svg")]) >= 25
    assert all(complete and natural > 0 and alt > 20 for complete, natural, _, alt, _ in pictures)
    assert all(shown <= width for _, _, shown, _, _ in pictures)
    # Points of a figure's own width: what a label's letters measure on the screen. The wiki page in
    # its own size is wider than a phone; its legend has larger letters instead.
    points = {figure: 13 if figure == "wiki-page" else 10 for *_, figure in pictures}
    letters = [
        shown / natural * points[figure] * 96 / 72
        for _, natural, shown, _, figure in pictures
        if natural < 1000
    ]
    assert min(letters) >= 8
    if not mobile:
        own = {figure: (natural, shown) for _, natural, shown, _, figure in pictures}["wiki-page"]
        assert own[0] == own[1] == 600
    assert browser.execute_script("return getComputedStyle(document.body).fontSize") == "16px"


def test_asks_the_network_for_nothing_and_logs_no_error(browser: Any, page: Path) -> None:
    browser.get_log("performance")
    browser.get_log("browser")
    browser.get(page.as_uri())
    asked = [
        entry["message"]
        for entry in browser.get_log("performance")
        if '"Network.requestWillBeSent"' in entry["message"]
    ]
    assert not [message for message in asked if '"url":"http' in message]
    assert browser.get_log("browser") == []


def test_numbers_behind_a_figure_open_by_keyboard(browser: Any, page: Path) -> None:
    from selenium.webdriver.common.keys import Keys

    browser.get(page.as_uri())
    summary = browser.find_element("css selector", "#youtube-durations summary")
    table = browser.find_element("css selector", "#youtube-durations details table")
    assert not table.is_displayed()
    summary.send_keys(Keys.ENTER)
    assert table.is_displayed()
    assert "minutes" in table.text
