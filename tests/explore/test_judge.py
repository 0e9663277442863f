"""The page Judge: keys alone, in a real browser, into the rows that Label Studio's answers are."""

import re
import shutil
from collections.abc import Iterator
from fractions import Fraction
from pathlib import Path
from typing import Any

import pytest
from selenium.webdriver import ActionChains
from selenium.webdriver.common.by import By
from selenium.webdriver.support.ui import WebDriverWait

from kb.artifacts.measures import read_measures
from kb.core.errors import SettingError
from kb.labels.judging import annotator_number
from kb.query import connect, select
from kb.release.metadata.quality import judgements
from tests.clips.films import film
from tests.explore.conftest import Explored, explored
from tests.inprocess import Here
from tests.labels.answers import exported, judgement

KEYS = "1qa"  # yes to each of the three questions


@pytest.fixture
def root(demo: Path, tmp_path: Path) -> Path:
    """A copy of the demo's root, in which nobody has judged."""
    return Path(shutil.copytree(demo / "data" / "demo", tmp_path / "data"))


def labels(root: Path) -> list[dict[str, Any]]:
    if not (root / "labels").is_dir():
        return []
    with connect(root) as db:
        return select(db, "FROM labels").read_all().to_pylist()


def contents(root: Path) -> dict[Path, bytes]:
    return {path: path.read_bytes() for path in root.rglob("*") if path.is_file()}


class Seat:
    """The page in a browser, used by keys alone."""

    def __init__(self, browser: Any, pages: Explored, query: str = "") -> None:
        self._browser = browser
        browser.get(f"{pages.address}judge?{query}")

    def text(self, selector: str) -> str:
        return self._browser.find_element(By.CSS_SELECTOR, selector).text

    @property
    def item(self) -> str:
        (shown,) = self._browser.find_elements(By.ID, "item") or [None]
        return shown.get_attribute("data-item") if shown else ""

    def press(self, keys: str) -> None:
        ActionChains(self._browser).send_keys(keys).perform()

    def until(self, selector: str, words: str) -> None:
        """Wait until an element has these words."""
        script = "return document.querySelector(arguments[0])?.textContent ?? ''"
        WebDriverWait(self._browser, 20, 0.05).until(
            lambda page: words in page.execute_script(script, selector)
        )

    def judge(self, number: int) -> None:
        """Answer all questions of the item, which is the one of this number."""
        self.press(KEYS)
        self.until("#progress", f"{number} of")


@pytest.mark.slow
def test_fifty_pairs_by_keyboard_in_two_sittings_and_a_second_person(
    browser: Any, root: Path, here: Here
) -> None:
    before = contents(root)
    with explored(root, "--judge", "Anna") as pages:
        seat = Seat(browser, pages, "sample=50")
        for number in range(1, 21):
            seat.judge(number)
        seat.press("1")  # of the next one only this
        seat.until("#questions button[aria-pressed=true]", "Yes")
    browser.get("about:blank")
    assert len(labels(root)) == 61
    with explored(root, "--judge", " ANNA ") as pages:
        seat = Seat(browser, pages, "sample=50")
        assert "20 of 50" in seat.text("#progress")
        assert "Yes" in seat.text("#questions button[aria-pressed=true]")
        seat.press("qa")
        for number in range(21, 51):
            seat.until("#progress", f"{number} of")
            if number < 50:
                seat.press(KEYS)
        seat.until("main", "You have judged all 50")
    rows = labels(root)
    assert len({row["item_id"] for row in rows}) == 50
    assert {row["annotator"] for row in rows} == {annotator_number("anna")}
    assert {(row["question"], row["answer"]) for row in rows} == {
        ("visible", "yes"),
        ("described", "yes"),
        ("on_time", "yes"),
    }
    times = {(row["item_id"], row["labelled_at"]) for row in rows}
    assert len(times) == 50
    with explored(root, "--judge", "Ben") as pages:
        for _ in range(10):
            form = fields(pages, "sample=50")
            pages.post("/judge", form | {"visible": "no", "described": "no", "on_time": "never"})
    said = " ".join(judgements(read_measures(root / "pairs"), "pair"))
    assert "2 people judged 50 pairs" in said
    assert "kappa" in said
    # Not in all files: of compressed bytes and base64, some have these four letters by chance.
    changed = {
        path: content for path, content in contents(root).items() if content != before.get(path)
    }
    assert changed
    assert [path for path, content in changed.items() if b"Anna" in content] == []
    done = here("build", "tasks", "--data", str(root))
    assert done.code == 0, done.err


def fields(pages: Explored, query: str = "") -> dict[str, str]:
    """The hidden fields of the page's form."""
    form = pages.ask(f"/judge?{query}").text.partition('id="questions"')[2].partition("</form>")[0]
    return dict(re.findall(r'type="hidden" name="(\w+)" value="([^"]*)"', form))


def test_undo_and_skip(browser: Any, root: Path) -> None:
    with explored(root, "--judge", "Anna") as pages:
        seat = Seat(browser, pages, "sample=3")
        first = seat.item
        seat.judge(1)
        second = seat.item
        seat.press("u")
        seat.until("#progress", "0 of 3")
        assert (seat.item, len(labels(root))) == (first, 2)
        seat.press("g")
        seat.until("#progress", "1 of 3")
        assert {row["answer"] for row in labels(root)} == {"yes", "unsure"}
        seat.press("x")
        WebDriverWait(browser, 20).until(lambda _: seat.item not in (first, second))
        seat.judge(2)
        assert seat.item == second


def test_a_task_has_times_and_a_wording(browser: Any, root: Path) -> None:
    with explored(root, "--judge", "Anna") as pages:
        seat = Seat(browser, pages, "what=tasks&sample=5")
        first = seat.item
        seat.press("1")
        seat.until("#questions button[aria-pressed=true]", "Yes")
        seat.press("q")
        seat.until("#progress", "1 of 5")
        assert seat.item == first
        seat.press("a12\tb")  # no letter in a field of seconds
        seat.press("\ue0061")  # Enter, behind which keys answer again
        WebDriverWait(browser, 20).until(lambda _: len(labels(root)) == 3)
        seat.until("#progress", "1 of 5")
    given = {row["question"]: row["answer"] for row in labels(root)}
    assert given == {"is_task": "yes", "possible": "yes", "begins_s": "12"}


def test_answers_are_rows_as_those_of_label_studio(root: Path, here: Here) -> None:
    with explored(root, "--judge", "Anna") as pages:
        form = fields(pages)
        assert pages.post("/judge", form | {"visible": "no", "on_time": "late"}).status == 303
        assert pages.post("/judge", form | {"visible": "perhaps"}).status == 400
    (video,) = {row["video_id"] for row in labels(root)}
    data = {"item_id": form["item"], "kind": "pair", "video_id": video}
    file = exported(root / "e.json", [(data, [judgement(7, visible="no", on_time="late")])])
    assert here("label", "import", str(file), "--data", str(root)).code == 0
    mine, theirs = (
        [{k: v for k, v in row.items() if k not in ("annotator", "labelled_at")} for row in rows]
        for rows in (
            [row for row in labels(root) if row["annotator"] != 7],
            [row for row in labels(root) if row["annotator"] == 7],
        )
    )
    assert mine == theirs != []


@pytest.mark.parametrize(
    ("headers", "changes"),
    [
        ({"Origin": "http://evil.example"}, {}),
        ({"Origin": "null"}, {}),
        ({"Origin": "https://127.0.0.1"}, {}),
        ({}, {"token": ""}),
        ({}, {"token": "é"}),
        ({}, {"token": "guessed", "undo": "1"}),
    ],
)
def test_only_the_page_itself_answers(
    judged_pages: tuple[Path, Explored], headers: dict[str, str], changes: dict[str, str]
) -> None:
    root, pages = judged_pages
    answer = pages.post("/judge", fields(pages) | {"visible": "no"} | changes, **headers)
    assert answer.status == 403
    assert labels(root) == []
    assert "frame-ancestors 'none'" in answer.headers["content-security-policy"]


@pytest.fixture(scope="module")
def judged_pages(
    demo: Path, tmp_path_factory: pytest.TempPathFactory
) -> Iterator[tuple[Path, Explored]]:
    """A root and its pages, where nothing is answered."""
    root = tmp_path_factory.mktemp("judged") / "data"
    shutil.copytree(demo / "data" / "demo", root)
    with explored(root, "--judge", "Anna") as pages:
        yield root, pages


def test_nobody_judges_without_being_named(demo_pages: Explored, release_pages: Explored) -> None:
    for pages in (demo_pages, release_pages):
        assert "kb explore --judge NAME" in pages.ask("/judge").text
        assert pages.post("/judge", {"item": "x", "visible": "no"}).status == 403
        assert [pages.ask(path).status for path in ("/clip", "/film", "/frames")] == [403] * 3


def test_a_download_and_nobody_are_refused(demo: Path) -> None:
    with explored(demo / "data" / "demo" / "release", "--judge", "Anna") as pages:
        assert pages.address == ""
    with pytest.raises(SettingError):
        annotator_number(" \t")


def test_a_name_has_one_number_that_nobody_else_has() -> None:
    number = annotator_number("Ａnna  Example")
    assert number == annotator_number("anna example")
    assert 2**52 <= number < 2**53
    assert number != annotator_number("Ann")


def test_the_clip_is_ones_own_film_or_its_frames_and_the_player_only_without_one(
    browser: Any, demo: Path, tmp_path: Path
) -> None:
    root = Path(shutil.copytree(demo / "data" / "demo", tmp_path / "data"))
    films = tmp_path / "films"
    films.mkdir()
    with explored(root, "--judge", "Anna", "--videos", films) as pages:
        seat = Seat(browser, pages, "sample=1")
        assert not browser.find_element(By.TAG_NAME, "iframe").get_attribute("src")
        clip = browser.find_element(By.CSS_SELECTOR, "a[target=clip]").get_attribute("href")
        answer = pages.ask(clip.removeprefix(pages.address.rstrip("/")))
        assert "https://www.youtube.com/embed/" in answer.text
        assert "frame-src https://www.youtube.com;" in answer.headers["content-security-policy"]
        (video, length) = _video(root, seat.item)
        # MPEG-4 part 2 is a film that no browser plays.
        ticks = range(int(length) * 2)
        film(films / f"{video}.avi", "mpeg4", ticks, Fraction(1, 2), (160, 90))
        seat.press("p")
        browser.switch_to.frame("clip")
        script = "return document.querySelector('#frames img')?.naturalWidth ?? 0"
        WebDriverWait(browser, 30).until(lambda page: page.execute_script(script) == 6 * 256)
        assert "can't play" in browser.find_element(By.ID, "frames").text
        browser.switch_to.default_content()
        address = f"/film?video={video}"
        part = pages.ask(address, Range="bytes=0-3")
        assert (part.status, part.text) == (206, "RIFF")
        assert pages.ask("/film?video=..%2Fdata").status == 404


def _video(root: Path, pair: str) -> tuple[str, float]:
    with connect(root) as db:
        sql = f"""SELECT video_id, duration_s FROM pairs JOIN youtube_videos USING (video_id)
            WHERE pair_id = '{pair}'"""
        (row,) = select(db, sql).read_all().to_pylist()
    return row["video_id"], row["duration_s"]
