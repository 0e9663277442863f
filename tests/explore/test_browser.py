"""The pages in a real browser: hostile data, no request elsewhere, keys, and any width."""

import json
from collections.abc import Iterator
from typing import Any

import pytest
from selenium.webdriver import ActionChains
from selenium.webdriver.common.by import By
from selenium.webdriver.common.keys import Keys
from selenium.webdriver.support.ui import WebDriverWait

from kb.store.tables.shard_writer import write_table
from tests.explore.conftest import Explored, explored

HOSTILE = "<script>document.title='owned'</script><img src=x onerror=\"document.title='owned'\">"
PAGES = (
    "",
    "search",
    "rows?source=youtube&verdict=rejected",
    "rows?source=reddit",
    "thresholds?source=youtube&stage=toxicity",
    "pairs?keyword=creeper",
    "status",
)


@pytest.fixture(scope="module")
def hostile(tmp_path_factory: pytest.TempPathFactory, make_rows: Any) -> Iterator[Explored]:
    """A root whose titles, texts and keywords are markup."""
    root = tmp_path_factory.mktemp("hostile")
    videos = make_rows("youtube/videos", 3, title=[HOSTILE] * 3)
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


@pytest.mark.parametrize("width", [400, 1920])
@pytest.mark.parametrize("path", PAGES)
def test_the_page_fits_its_window(
    browser: Any, demo_pages: Explored, path: str, width: int
) -> None:
    browser.execute_cdp_cmd(
        "Emulation.setDeviceMetricsOverride",
        {"width": width, "height": 800, "deviceScaleFactor": 1, "mobile": width < 500},
    )
    browser.get(demo_pages.address + path)
    wide = "return document.documentElement.scrollWidth <= window.innerWidth"
    assert browser.execute_script(wide)


def test_keys_turn_pages_and_go_from_pair_to_pair(browser: Any, demo_pages: Explored) -> None:
    browser.get(f"{demo_pages.address}pairs?keyword=creeper")

    def press(key: str) -> None:
        ActionChains(browser).send_keys(key).perform()

    press("j")
    press("j")
    focused = browser.switch_to.active_element
    assert focused == browser.find_elements(By.CSS_SELECTOR, "article a")[1]
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
    assert browser.find_element(By.ID, "line").text == f"min_views = {value}"
    assert browser.find_element(By.ID, "copy").is_displayed()
    browser.get(f"{demo_pages.address}thresholds?source=youtube&stage=views&value={value}")
    assert browser.find_element(By.ID, "figures").text == figures
