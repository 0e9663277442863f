"""The page in the real browser: on a phone and on a desk, without any request or error."""

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from selenium import webdriver
from selenium.webdriver.chrome.service import Service

from kb.core.errors import MissingExtra
from kb.wiki.browser import chromium
from tests.conftest import skip_or_fail

SIZES = {320: (568, True), 420: (900, True), 1440: (900, False), 1920: (1080, False)}
# Text is large from 24 px on, or 18.66 px in bold (WCAG 2.2, 1.4.3).
CONTRAST = """
const rgb = text => (text.match(/[\\d.]+/g) || []).map(Number);
const light = ([r, g, b]) => [r, g, b].map(v => v / 255)
  .map(v => v <= 0.04045 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4)
  .reduce((sum, v, at) => sum + v * [0.2126, 0.7152, 0.0722][at], 0);
const behind = element => {
  for (; element; element = element.parentElement) {
    const color = rgb(getComputedStyle(element).backgroundColor);
    if (color.length < 4 || color[3] === 1) return color;
  }
  return [255, 255, 255];
};
const ratio = (a, b) => (Math.max(a, b) + 0.05) / (Math.min(a, b) + 0.05);
const texts = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
const found = [];
for (let node; node = texts.nextNode();) {
  const of = node.parentElement, style = getComputedStyle(of);
  if (!node.data.trim() || of.closest("svg")) continue;
  const size = parseFloat(style.fontSize);
  const least = size >= 24 || (size >= 18.66 && style.fontWeight >= 700) ? 3 : 4.5;
  const has = ratio(light(rgb(style.color)), light(behind(of)));
  found.push([has >= least, `${node.data.trim().slice(0, 40)}: ${has.toFixed(2)}`]);
}
for (const mark of document.querySelectorAll("svg.chart [fill], svg.chart [stroke]")) {
  const card = mark.closest("figure");
  const lettered = card.id.endsWith("-words") ? /--(?!card)/ : /--(ink|soft)/;
  for (const what of ["fill", "stroke"]) {
    const color = mark.getAttribute(what) || "";
    if (!lettered.test(color)) continue;
    const has = ratio(light(rgb(getComputedStyle(mark)[what])), light(behind(card)));
    found.push([has >= 4.5, `${card.id}: ${has.toFixed(2)}`]);
  }
}
return found;
"""
# What lies between the lower edge of a column and that of the longest beside it.
BLANK = """
return [...document.querySelectorAll(".stacks")].map(row => {
  const ends = [...row.children].map(one => one.lastElementChild.getBoundingClientRect().bottom);
  return Math.max(...ends) - Math.min(...ends);
});
"""


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
        programs = chromium.find_programs()
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


@pytest.mark.parametrize("width", SIZES)
def test_figures_keep_their_size_and_nothing_scrolls_sideways(
    browser: Any, page: Path, width: int
) -> None:
    height, mobile = SIZES[width]
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
        " [i.complete ?? true, i.naturalWidth / 2 || i.viewBox.baseVal.width * 96 / 72,"
        " i.getBoundingClientRect().width, (i.alt || i.ariaLabel).length, i.parentElement.id])"
    )
    assert len(pictures) == len([*page.parent.glob("*.svg")]) >= 25
    assert all(complete and alt > 20 for complete, *_, alt, _ in pictures)
    # A picture's border is around its own pixels.
    assert all(0.6 * own < shown <= own + 2 for _, own, shown, _, _ in pictures)
    # Points of a figure's own width: what a label's letters measure on the screen.
    letters = [
        shown / own * 10 * 96 / 72 for _, own, shown, _, name in pictures if "wiki" not in name
    ]
    assert min(letters) >= 8
    if not mobile:
        own = {name: (natural, shown) for _, natural, shown, _, name in pictures}["wiki-page"]
        assert own == (400, pytest.approx(400, abs=2))
        assert max(browser.execute_script(BLANK)) < 500
    assert browser.execute_script("return getComputedStyle(document.body).fontSize") == "16px"


@pytest.mark.parametrize("theme", ["light", "dark"])
def test_texts_and_axes_are_readable_in_the_theme(browser: Any, page: Path, theme: str) -> None:
    browser.execute_cdp_cmd(
        "Emulation.setEmulatedMedia",
        {"features": [{"name": "prefers-color-scheme", "value": theme}]},
    )
    browser.get(page.as_uri())
    ground = browser.execute_script("return getComputedStyle(document.body).backgroundColor")
    assert (min(map(int, re.findall(r"\d+", ground))) > 200) == (theme == "light")
    browser.execute_script("document.querySelectorAll('details').forEach(one => one.open = true)")
    found = browser.execute_script(CONTRAST)
    assert len(found) > 400
    assert [what for readable, what in found if not readable] == []


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
