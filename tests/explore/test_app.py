"""The pages over HTTP: who may ask, what is answered, and that nothing is written."""

import re
import shutil
import signal
import socket
from pathlib import Path
from typing import Any

import pyarrow.parquet as pq
import pytest

from kb.store.tables.shard_writer import write_table
from tests.conftest import ROOT
from tests.explore.conftest import Explored, explored

PAGES = (
    *("/", "/search", "/rows", "/rows?source=reddit&verdict=rejected", "/thresholds", "/pairs"),
    *("/status", "/judge", "/runs"),
)


@pytest.mark.parametrize("path", PAGES)
def test_every_page_answers_with_a_strict_policy(demo_pages: Explored, path: str) -> None:
    answer = demo_pages.ask(path)
    assert answer.status == 200
    policy = answer.headers["content-security-policy"]
    assert policy.startswith("default-src 'none'; script-src 'self'; style-src 'self'")
    assert "unsafe" not in policy
    own = "same-origin" if path == "/judge" else "no-referrer"  # a form there says its origin
    assert answer.headers["referrer-policy"] == own
    assert answer.headers["x-content-type-options"] == "nosniff"
    assert "<style" not in answer.text
    assert " style=" not in answer.text
    assert "onclick" not in answer.text


@pytest.mark.parametrize("path", [*PAGES, "/nothing", "/search?words=x&since=monday"])
def test_every_page_of_a_demo_says_once_that_its_data_are_invented(
    demo_pages: Explored, path: str
) -> None:
    assert demo_pages.ask(path).text.count("All data here are invented") == 1


def test_no_page_of_other_data_says_so(tmp_path: Path, make_rows: Any) -> None:
    videos = make_rows("youtube/videos", 3)
    write_table(tmp_path / "clean/youtube/videos/videos-0.parquet", videos, "youtube/videos")
    with explored(tmp_path) as pages:
        for path in PAGES:
            assert "invented" not in pages.ask(path).text


@pytest.mark.parametrize("host", ["evil.example", "127.0.0.1.evil.example", "10.0.0.1"])
def test_another_host_is_refused(demo_pages: Explored, host: str) -> None:
    answer = demo_pages.ask("/", Host=host)
    assert answer.status == 400
    assert "content-security-policy" in answer.headers
    assert demo_pages.ask("/", Host=f"localhost:{demo_pages.port}").status == 200


@pytest.mark.parametrize("method", ["POST", "PUT", "DELETE", "PATCH"])
def test_nothing_but_reading_is_allowed(demo_pages: Explored, method: str) -> None:
    assert demo_pages.ask("/rows", method).status == 405


@pytest.mark.parametrize(
    ("path", "status", "said"),
    [
        ("/nothing", 404, "Not Found"),
        ("/rows?source=x", 400, "unknown source &#39;x&#39;; use one of youtube, wiki, reddit"),
        ("/rows?page=0", 400, "there is no page &#39;0&#39;"),
        ("/rows?sort=password", 400, "unknown column &#39;password&#39;"),
        ("/rows?source=youtube&sort=title&page=101", 400, "there is no page &#39;101&#39;"),
        ("/pairs?page=x", 400, "there is no page &#39;x&#39;"),
        ("/static/../app.py", 404, "Not Found"),
    ],
)
def test_a_wrong_address_gets_one_clear_line(
    demo_pages: Explored, path: str, status: int, said: str
) -> None:
    answer = demo_pages.ask(path)
    assert answer.status == status
    assert said in answer.text
    assert "Traceback" not in answer.text


def test_nothing_is_written_into_a_download(release_pages: Explored, demo: Path) -> None:
    folder = demo / "data" / "demo" / "release"
    before = {path: path.stat().st_mtime_ns for path in folder.rglob("*")}
    for path in PAGES:
        assert release_pages.ask(path).status == 200
    assert {path: path.stat().st_mtime_ns for path in folder.rglob("*")} == before


def test_a_folder_without_tables_and_a_port_that_is_taken_are_refused(
    demo_pages: Explored, demo: Path, tmp_path: Path
) -> None:
    with explored(tmp_path / "nothing") as nothing:
        assert nothing.address == ""
    with explored(demo / "data" / "demo", "--port", str(demo_pages.port)) as second:
        assert second.address == ""


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_ends_it_as_done(demo: Path, number: signal.Signals) -> None:
    with explored(demo / "data" / "demo") as pages:
        assert pages.ask("/").status == 200
        pages.process.send_signal(number)
        assert pages.process.wait(30) == 0


def test_a_signal_ends_it_while_130_requests_wait(demo: Path) -> None:
    with explored(demo / "data" / "demo") as pages:
        waiting = [socket.create_connection(("127.0.0.1", pages.port)) for _ in range(130)]
        for one in waiting:
            one.sendall(b"GET /thresholds HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n")
        assert waiting[0].recv(1) == b"H"  # all others are in hand; answering them takes a minute
        pages.process.send_signal(signal.SIGTERM)
        assert pages.process.wait(15) == 0


@pytest.mark.slow
def test_connections_that_send_no_whole_request_are_closed(demo_pages: Explored) -> None:
    waiting = [socket.create_connection(("127.0.0.1", demo_pages.port)) for _ in range(100)]
    for number, one in enumerate(waiting):
        one.settimeout(120)
        one.sendall(b"GET / HTTP/1.1\r\nHost: 127.0.0.1\r\nX-Slow: "[: number % 40])
    assert demo_pages.ask("/").status == 200
    assert {one.recv(1) for one in waiting} == {b""}
    assert demo_pages.ask("/").status == 200


def test_the_overview_counts_what_there_is_and_names_what_is_out_of_date(
    demo: Path, tmp_path: Path
) -> None:
    root, profile = demo / "data" / "demo", tmp_path / "profile"
    shutil.copytree(ROOT / "data" / "profiles" / "minecraft", profile)
    path = profile / "profile.toml"
    path.write_text(path.read_text().replace("min_views = 100", "min_views = 500"))
    with explored(root, "--profile", str(path)) as pages:
        text = pages.ask("/").text
    for name, noun in (("youtube/videos", "videos"), ("reddit/comments", "comments")):
        rows = sum(pq.read_metadata(one).num_rows for one in (root / "clean" / name).iterdir())
        assert f"<li><b>{rows:,}</b> {noun}</li>" in text
    stale = text.partition("What is out of date")[2]
    assert "youtube.min_views 100 → 500" in stale
    assert f"kb build --data {root}" in stale


def test_a_release_says_what_to_do_with_it(release_pages: Explored) -> None:
    text = release_pages.ask("/").text
    assert "kb restore" in text
    assert "out of date" not in text
    assert (
        "A release holds no rejected rows"
        in release_pages.ask("/rows?source=youtube&verdict=rejected").text
    )


def test_runs_and_the_graph_of_what_is_made(demo_pages: Explored, release_pages: Explored) -> None:
    text = demo_pages.ask("/runs").text
    assert re.search(r"<td[^>]*>demo</td><td[^>]*>18 steps", text)
    assert "No run has written here" in release_pages.ask("/runs").text
    picture = demo_pages.ask("/graph.svg")
    assert (picture.status, picture.headers["content-type"]) == (200, "image/svg+xml")
    assert "clean/youtube" in picture.text
    assert '<img src="/graph.svg"' in demo_pages.ask("/status").text
