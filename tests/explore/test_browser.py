"""The pages in a real browser: hostile data, no request elsewhere, keys, and any width."""

import html
import json
import re
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from selenium.webdriver import ActionChains
from selenium.webdriver.common.by import By
from selenium.webdriver.common.keys import Keys
from selenium.webdriver.support.ui import WebDriverWait

from kb.store.tables.shard_writer import write_table
from tests.conftest import ROOT
from tests.explore.conftest import Explored, explored

AXE = ROOT / ".venv" / "node_modules" / "axe-core" / "axe.min.js"
HOSTILE = "<script>document.title='owned'</script><img src=x onerror=\"document.title='owned'\">"
PAGES = (
    "",
    "search",
    "rows?source=youtube&verdict=rejected",
    "rows?source=reddit",
    "thresholds?source=youtube&stage=toxicity",
    "pairs?keyword=creeper",
    *("status", "judge", "runs"),
)


@pytest.fixture(scope="module")
def hostile(tmp_path_factory: pytest.TempPathFactory, make_rows: Any) -> Iterator[Explored]:
    """A root whose titles, texts and keywords are markup."""
    root = tmp_path_factory.mktemp("hostile")
    ids = [f"aaaaaaaaaa{number}" for number in range(3)]
    videos = make_rows("youtube/videos", 3, title=[HOSTILE] * 3, video_id=ids)
    text = {name: [HOSTILE] * 3 for name in ("keyword", "text")}
    pairs = make_rows("pairs/pairs", 3, **text)
    write_table(root / "clean/youtube/videos/videos-0.parquet", videos, "youtube/videos")
    write_table(root / "pairs/pairs-00000-of-00001.parquet", pairs, "pairs/pairs")
    with explored(root) as pages:
        yield pages


@pytest.mark.parametrize(
    "path", ["", "rows?source=youtube", "thresholds", "pairs", f"pairs?keyword={HOSTILE}"]
)
def test_no_script_of_the_data_runs(browser: Any, hostile: Explored, path: str) -> None:
    browser.get(hostile.address + path)
    assert "owned" not in browser.title
    if path == "rows?source=youtube":  # and the page of the first row
        browser.find_element(By.CSS_SELECTOR, "td a").click()
        assert browser.find_element(By.TAG_NAME, "h1").text == HOSTILE
        assert not browser.find_elements(By.CSS_SELECTOR, "main script, main img")
        browser.back()
    assert not browser.find_elements(By.CSS_SELECTOR, "main script, main img")
    if path in ("rows?source=youtube", "thresholds", "pairs"):
        assert "<script>" in browser.find_element(By.TAG_NAME, "main").text


@pytest.mark.parametrize("path", PAGES)
def test_no_request_leaves_this_machine(browser: Any, demo_pages: Explored, path: str) -> None:
    browser.get_log("performance")
    browser.get_log("browser")
    browser.get(demo_pages.address + path)
    asked = [
        message["params"]["request"]["url"]
        for entry in browser.get_log("performance")
        if (message := json.loads(entry["message"])["message"])["method"]
        == "Network.requestWillBeSent"
    ]
    assert asked
    here = (demo_pages.address, "data:")  # data: the browser's own icon of a date field
    assert [url for url in asked if not url.startswith(here)] == []
    assert browser.get_log("browser") == []


# Texts that are shown too faint on what is behind them (WCAG AA: 4.5 to 1).
FAINT = """
const parse = (text) => text.match(/[\\d.]+/g).map(Number);
const light = (rgb) => {
  const [r, g, b] = rgb.map((v) => v / 255)
    .map((v) => (v <= 0.03928 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4));
  return 0.2126 * r + 0.7152 * g + 0.0722 * b;
};
const ground = (one) => {
  for (; one; one = one.parentElement) {
    const [r, g, b, a = 1] = parse(getComputedStyle(one).backgroundColor);
    if (a === 1) return [r, g, b];
  }
  return [255, 255, 255];
};
const faint = [];
for (const one of document.querySelectorAll("body *")) {
  const own = [...one.childNodes].some((n) => n.nodeType === 3 && n.textContent.trim());
  if (!own || !one.checkVisibility() || one.matches("title, option, datalist *")) continue;
  const style = getComputedStyle(one);
  const colour = one.closest("svg") ? style.fill : style.color;
  const [a, b] = [light(parse(colour).slice(0, 3)), light(ground(one))];
  const ratio = (Math.max(a, b) + 0.05) / (Math.min(a, b) + 0.05);
  if (ratio < 4.5) faint.push(`${one.tagName} ${one.className} ${one.textContent} ${ratio}`);
}
return faint;
"""


@pytest.fixture(scope="module")
def every_page(demo_pages: Explored) -> list[str]:
    """Addresses of all kinds of pages, also of those that rows and pairs lead to."""
    found = [
        (path, re.findall(r'href="/(document\?[^"]*)"', demo_pages.ask(f"/{path}").text)[0])
        for path in (
            "pairs?keyword=creeper",
            "search?words=creeper&source=wiki&kind=section",
            "rows?source=reddit&table=comments&sort=depth&descending=1",
            "rows?source=reddit&verdict=rejected&stage=toxicity",
            "rows?source=youtube&verdict=rejected&stage=toxicity",
        )
    ]
    return [*PAGES, "search?words=creeper", *(html.unescape(link) for _, link in found)]


def emulate(browser: Any, width: int, theme: str = "light") -> None:
    size = {"width": width, "height": 800, "deviceScaleFactor": 1, "mobile": width < 500}
    scheme = {"features": [{"name": "prefers-color-scheme", "value": theme}]}
    browser.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", size)
    browser.execute_cdp_cmd("Emulation.setEmulatedMedia", scheme)


def test_pages_fit_their_window_and_can_be_read(
    browser: Any, demo_pages: Explored, every_page: list[str]
) -> None:
    for path in every_page:
        browser.get(demo_pages.address + path)
        for width, theme in ((420, "dark"), (1440, "light")):
            emulate(browser, width, theme)
            shown = browser.execute_script("return document.documentElement.scrollWidth")
            assert shown <= width, (path, width)
            assert browser.execute_script(FAINT) == [], (path, theme)


def test_axe_has_nothing_to_say(
    browser: Any, demo_pages: Explored, every_page: list[str], tmp_path: Path, demo: Path
) -> None:
    """Deque's axe-core, where set-up found npm; else the script above looks at colours alone."""
    if not AXE.is_file():
        pytest.skip("no axe-core: set-up found no npm")
    root = Path(shutil.copytree(demo / "data" / "demo", tmp_path / "data"))
    with explored(root, "--judge", "Anna") as judging:
        paths = [demo_pages.address + path for path in every_page]
        paths += [f"{judging.address}judge?what={what}" for what in ("pairs", "tasks")]
        broken = {}
        for address in paths:
            browser.get(address)
            browser.execute_script(AXE.read_text())
            broken[address] = browser.execute_async_script(
                "axe.run().then((said) => arguments[0](said.violations.map((rule) =>"
                " [rule.id, rule.nodes.slice(0, 3).map((node) => node.html)])))"
            )
        assert {address: rules for address, rules in broken.items() if rules} == {}


def test_a_page_of_pairs_is_about_two_screens(browser: Any, demo_pages: Explored) -> None:
    emulate(browser, 1440)
    browser.get(f"{demo_pages.address}pairs?keyword=creeper")
    assert browser.execute_script("return document.documentElement.scrollHeight") < 2400


def test_a_text_and_its_box_light_up_together(
    browser: Any, demo_pages: Explored, every_page: list[str]
) -> None:
    browser.get(demo_pages.address + next(path for path in every_page if "ref=wiki" in path))
    text = browser.find_element(By.CSS_SELECTOR, "#here p[data-block]")
    number = text.get_attribute("data-block")
    box = browser.find_element(By.CSS_SELECTOR, f'g[data-block="{number}"]')
    browser.execute_script("arguments[0].focus()", text)
    assert "lit" in box.get_attribute("class")
    ActionChains(browser).move_to_element(browser.find_element(By.TAG_NAME, "h1")).perform()
    browser.execute_script("document.activeElement.blur()")
    assert "lit" not in box.get_attribute("class")
    rect = box.find_element(By.TAG_NAME, "rect")
    ActionChains(browser).move_to_element(rect).perform()
    assert "lit" in text.get_attribute("class")


def test_the_slider_stands_below_the_bar_of_its_threshold(
    browser: Any, demo_pages: Explored
) -> None:
    """The middle of the thumb, which runs from half its width inside, is where the line is."""
    emulate(browser, 1440)
    browser.get(f"{demo_pages.address}thresholds?source=youtube&stage=views")
    slider, line = browser.execute_script(
        "const s = document.querySelector('#slider input[type=range]');"
        "const r = s.getBoundingClientRect(), half = 8;"
        "const l = document.querySelector('.histogram line.current').getBoundingClientRect();"
        "return [r.left + half + (r.width - 2 * half) * s.value / s.max, l.left + l.width / 2]"
    )
    assert abs(slider - line) < 2
    labels = [one.text for one in browser.find_elements(By.CSS_SELECTOR, ".histogram text.x")]
    assert {"0", "10k", "1M"} <= set(labels)


def test_keys_turn_pages_and_go_from_pair_to_pair(browser: Any, demo_pages: Explored) -> None:
    browser.get(f"{demo_pages.address}pairs?keyword=creeper")

    def press(key: str) -> None:
        ActionChains(browser).send_keys(key).perform()

    press("j")
    press("j")
    focused = browser.switch_to.active_element
    assert focused == browser.find_elements(By.CSS_SELECTOR, "article h2 a")[1]
    press("n")
    WebDriverWait(browser, 20).until(lambda _: "page=2" in browser.current_url)
    press("p")
    WebDriverWait(browser, 20).until(lambda _: "page=1" in browser.current_url)
    browser.get(demo_pages.address)
    press(Keys.TAB)
    assert browser.switch_to.active_element.text == "Skip to the content"


def test_the_slider_shows_the_figures_of_its_position(browser: Any, demo_pages: Explored) -> None:
    browser.get(f"{demo_pages.address}thresholds?source=youtube&stage=views")
    slider = browser.find_element(By.CSS_SELECTOR, "#slider input[type=range]")
    before = browser.find_element(By.ID, "figures").text
    slider.send_keys(*[Keys.ARROW_RIGHT] * 10)
    WebDriverWait(browser, 20).until(
        lambda _: f"step={slider.get_attribute('value')}" in browser.current_url
    )
    figures = browser.find_element(By.ID, "figures").text
    value = browser.find_element(By.CSS_SELECTOR, "#exact input[name=value]").get_attribute("value")
    assert figures != before
    assert browser.find_element(By.ID, "line").text == f"youtube.min_views = {value}"
    assert browser.find_element(By.ID, "copy").is_displayed()
    browser.get(f"{demo_pages.address}thresholds?source=youtube&stage=views&value={value}")
    assert browser.find_element(By.ID, "figures").text == figures
