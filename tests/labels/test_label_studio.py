"""The real Label Studio takes a project, shows it, and its export comes back as labels.

`make test-label` installs it in an environment of its own and runs this; elsewhere it is skipped,
as it brings 150 packages, some of them in other versions than ours.
"""

import json
import os
import shutil
import socket
import subprocess
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import requests

from kb.core.context import Run
from kb.labels.export import CONFIG, TASKS, export
from kb.labels.questions import PAIRS
from kb.query import connect, select
from tests.inprocess import Here

STUDIO = os.environ.get("KB_LABEL_STUDIO", "")
pytestmark = pytest.mark.skipif(not STUDIO, reason="KB_LABEL_STUDIO names no label-studio")

WHO = {"username": "a@example.org", "password": "invented-1"}
TOKEN = "0123456789abcdef0123456789abcdef01234567"
_QUIET = {"COLLECT_ANALYTICS": "0", "LATEST_VERSION_CHECK": "0"}


class Studio:
    """A Label Studio with one person, and a project of 6 pairs."""

    def __init__(self, address: str, project: Path) -> None:
        self.address = address
        self._session = requests.Session()
        self._session.headers["Authorization"] = f"Token {TOKEN}"
        config = (project / CONFIG).read_text()
        made = self.ask("POST", "projects", json={"title": "Pairs", "label_config": config})
        self.id = made.json()["id"]
        tasks = json.loads((project / TASKS).read_text())
        taken = self.ask("POST", f"projects/{self.id}/import", json=tasks)
        assert taken.json()["task_count"] == len(tasks)

    def ask(self, method: str, path: str, **given: Any) -> requests.Response:
        answer = self._session.request(method, f"{self.address}/api/{path}", timeout=60, **given)
        assert answer.ok, answer.text
        return answer

    def export(self, path: Path, kind: str) -> Path:
        where = f"projects/{self.id}/export?exportType={kind}&download_all_tasks=true"
        path.write_bytes(self.ask("GET", where).content)
        return path


@pytest.fixture
def studio(judged: Run, tmp_path: Path) -> Iterator[Studio]:
    export(judged, PAIRS, 6, 0, tmp_path / "project")
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = free.getsockname()[1]
    address, data = f"http://127.0.0.1:{port}", tmp_path / "studio"
    words = ["start", "--no-browser", "--data-dir", str(data), "-db", str(data / "studio.sqlite3")]
    words += ["--internal-host", "127.0.0.1", "-p", str(port), "--enable-legacy-api-token"]
    words += [f"--username={WHO['username']}", f"--password={WHO['password']}"]
    data.mkdir()
    with (
        (tmp_path / "log").open("w") as log,
        subprocess.Popen(
            [STUDIO, *words, f"--user-token={TOKEN}"],
            env=os.environ | _QUIET,
            cwd=tmp_path,
            stdout=log,
            stderr=log,
        ) as process,
    ):
        try:
            while process.poll() is None and not _answers(address):
                time.sleep(0.5)
            yield Studio(address, tmp_path / "project")
        finally:
            process.terminate()


def _answers(address: str) -> bool:
    try:
        return requests.get(f"{address}/health", timeout=5).ok
    except requests.ConnectionError:
        return False


def _label_in_the_page(studio: Studio, picture: Path) -> list[str]:
    """Answer the first item, skip the second; the addresses that their players show."""
    from selenium import webdriver
    from selenium.common.exceptions import ElementClickInterceptedException
    from selenium.webdriver.common.by import By
    from selenium.webdriver.support.wait import WebDriverWait

    options = webdriver.ChromeOptions()
    options.binary_location = shutil.which("chromium") or ""
    for one in ("--headless=new", "--no-sandbox", "--window-size=1280,900"):
        options.add_argument(one)
    service = webdriver.ChromeService(shutil.which("chromedriver"))
    with webdriver.Chrome(options=options, service=service) as page:
        wait = WebDriverWait(page, 60)

        def find(path: str) -> Any:
            return wait.until(lambda page: page.find_element(By.XPATH, path))

        def clicked(path: str) -> bool:
            try:  # a note covers the buttons for a moment
                find(path).click()
            except ElementClickInterceptedException:
                return False
            return True

        def players() -> list[str]:
            frames = wait.until(lambda page: page.find_elements(By.TAG_NAME, "iframe"))
            return [frame.get_attribute("src") for frame in frames]

        page.get(f"{studio.address}/user/login/")
        find("//input[@name='email']").send_keys(WHO["username"])
        find("//input[@name='password']").send_keys(WHO["password"])
        find("//button[@type='submit']").click()
        wait.until(lambda page: "login" not in page.current_url)
        page.get(f"{studio.address}/projects/{studio.id}/data?labeling=1")
        first = players()
        for number, shown in enumerate(("Yes", "Partly", "The clip is too early")):
            group = find(f"(//*[contains(@class, 'choices')][.//input])[{number + 1}]")
            group.find_element(By.XPATH, f".//*[starts-with(., '{shown}')]//input").click()
        page.save_screenshot(picture)
        find("//button[contains(., 'Submit')]").click()
        wait.until(lambda _: players() != first)
        second = players()
        wait.until(lambda _: clicked("//button[contains(., 'Skip')]"))
        wait.until(lambda _: players() != second)
        return [*first, *second]


def test_round_trip(studio: Studio, judged: Run, tmp_path: Path, here: Here) -> None:
    tasks = [one["data"] for one in json.loads((tmp_path / "project" / TASKS).read_text())]
    shown = _label_in_the_page(studio, tmp_path / "page.png")
    assert [one.partition("?")[0].rpartition("/")[2] for one in shown] == [
        one["video_id"] for one in tasks[:2]
    ]
    shutil.copytree(judged.root, tmp_path / "data")
    least = studio.export(tmp_path / "least.json", "JSON_MIN")
    assert here("label", "import", str(least), "--data", str(tmp_path / "data")).code == 2
    file = studio.export(tmp_path / "export.json", "JSON")
    done = here("label", "import", str(file), "--data", str(tmp_path / "data"), "--json")
    assert done.code == 0, done.err
    summary = json.loads(done.out.splitlines()[-1])
    assert (summary["answers"], summary["skipped"], summary["undefined"]) == (3, 1, 0)
    with connect(tmp_path / "data") as db:
        rows = select(db, "SELECT item_id, question, answer FROM labels").read_all().to_pylist()
    assert {row["item_id"] for row in rows} == {tasks[0]["item_id"]}
    given = {row["question"]: row["answer"] for row in rows}
    assert given == {"visible": "yes", "described": "partly", "on_time": "early"}
