"""The crawl on the sandbox's wiki: faults lose nothing, a kill costs nothing, limits and titles are
kept.
"""

import dataclasses
import json
import os
import re
import shutil
import signal
import threading
from pathlib import Path

import psutil
import pyarrow.parquet as pq
import pytest

from kb.core.config.pipeline import Recipe
from kb.core.errors import (
    Challenged,
    DamagedData,
    LimitReached,
    MissingExtra,
    OtherService,
    SettingError,
    Unreachable,
)
from kb.core.progress import Progress
from kb.export import minedojo
from kb.filters.filter_run import run_clean
from kb.sandbox.world import World
from kb.store.rawlog import rawlog
from kb.store.state import tombstones
from kb.store.state.frontier import Frontier
from kb.verify.root import verify
from kb.wiki import tar_shards
from kb.wiki.browser import chromium
from kb.wiki.browser.browser import Browser
from kb.wiki.crawl.connector import LAST_SECONDS, crawl
from tests import processes
from tests.faults import Sandbox
from tests.wiki.browser.test_chromium import ended
from tests.wiki.test_text import check_against_a_browser

NOW = "2026-11-20T12:00:00Z"
# The first pages by title: one with tables, one that is too short, one with picture files, one with
# an animation.
FEW = {24: "Charts", 31: "Fog", 23: "Harbour pictures", 28: "Lamp buoy"}


@pytest.fixture(scope="module", autouse=True)
def one_date():
    """All crawls of this file say the same `fetched_at`, so that their tables can be compared."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("KB_NOW", NOW)
        yield


@pytest.fixture(scope="module")
def sandbox(shared_browsers):
    with Sandbox(World(), services=["wiki"]) as held:
        yield held


@pytest.fixture
def faults(sandbox):
    yield sandbox.faults
    sandbox.faults.clear()


@pytest.fixture
def few(sandbox, monkeypatch):
    """The wiki lists a few pages only, for what a whole list shows no better."""
    monkeypatch.setattr(sandbox.world, "n_pages", len(FEW))


@pytest.fixture(scope="module")
def make_run(run_on, sandbox):
    def make(root: Path, **options):
        url = sandbox.servers["wiki"].url
        run = run_on(root, url, **{"workers": 1, **options})
        off = run.profile.toxicity.model_copy(update={"toxicity": "off"})
        return dataclasses.replace(run, profile=run.profile.model_copy(update={"toxicity": off}))

    return make


def by_two(run):
    """The same run with two workers: for a crawl, as what is filtered here is little."""
    return dataclasses.replace(run, workers=2)


def tables(run) -> dict[str, list[dict]]:
    """The clean tables, after filtering."""
    run_clean(run, "wiki")
    return {
        name: pq.read_table(run.root / "clean" / "wiki" / name).to_pylist()
        for name in ("pages", "elements", "cells", "images", "rejected", "failed")
    }


def of_few(found: dict[str, list[dict]]) -> dict[str, list[dict]]:
    """Those rows of the whole crawl's tables that are of a few pages."""
    return {
        name: [row for row in rows if int(row.get("page_id") or row["key"]) in FEW]
        for name, rows in found.items()
    }


@pytest.fixture(scope="module")
def whole(make_run, tmp_path_factory):
    """(run, summary, tables) of a crawl that nothing disturbed."""
    run = make_run(tmp_path_factory.mktemp("whole"))
    summary = crawl(by_two(run))
    return run, summary, tables(run)


def test_whole_crawl(whole, sandbox):
    _, summary, found = whole
    assert (summary["crawled"], summary["failed"], summary["pending"], summary["images"]) == (
        12,
        0,
        0,
        15,
    )
    assert {row["title"] for row in found["pages"]} >= {
        "Saltstone",
        "Île d'Écume & 岩島 (100%)",
        "Long pier",
    }
    assert found["rejected"] == []
    agents = {seen.agent for seen in sandbox.ledger.requests("")}
    assert len(agents) == 1
    assert "test@example.org" in agents.pop()


def test_pages_are_told_as_they_are_shown(copied, sandbox, programs):
    check_against_a_browser(copied, sandbox.servers["wiki"].url, programs)


def test_finished_crawl_asks_nothing(whole, sandbox):
    before = len(sandbox.ledger.requests(""))
    assert crawl(whole[0])["requests"] == 0
    assert len(sandbox.ledger.requests("")) == before


def test_faults_lose_nothing(whole, make_run, few, faults, tmp_path, hasty):
    """500, 503 with Retry-After, resets, cut and slow answers, of the API, pages, styles and
    pictures.
    """
    faults.add("/w/api.php", after=1, status=503, headers={"Retry-After": "1"}, times=2)
    faults.add("list=allpages", reset=True)
    faults.add("prop=imageinfo", status=500)
    faults.add("/wiki/Fog", status=500, times=2)
    faults.add("/wiki/Harbour_pictures", reset=True)
    faults.add("/wiki/Charts", status=503, headers={"Retry-After": "1"})
    faults.add("/static/common.css", status=503, times=1)
    faults.add("/images/Harbour_at_dawn.jpg", reset=True, times=2)
    faults.add("/images/Buoy_light.gif", cut=0.5)
    slow = faults.add("/wiki/Lamp_buoy", hold=True)
    threading.Timer(0.3, slow.release).start()
    run = make_run(tmp_path)
    assert crawl(by_two(run))["failed"] == 0
    found = tables(run)
    assert {row["title"] for row in found["pages"]} == {*FEW.values()}
    assert found == of_few(whole[2])


def environment(sandbox) -> dict[str, str]:
    """What a command needs to crawl the sandbox's wiki."""
    return {**os.environ, **sandbox.settings(), "KB_NOW": NOW, "KB_CONTACT": "test@example.org"}


def test_what_a_limit_stopped_goes_on_at_another_port(whole, run_on, programs, tmp_path):
    """Services of a sandbox are the same wiki wherever they listen."""

    def at(sandbox, **options):
        run = run_on(tmp_path / "data", sandbox.servers["wiki"].url, workers=1, **options)
        off = run.profile.toxicity.model_copy(update={"toxicity": "off"})
        return dataclasses.replace(run, profile=run.profile.model_copy(update={"toxicity": off}))

    names = tmp_path / "titles.txt"
    names.write_text("\n".join(reversed(FEW.values())))  # what has a picture comes first
    with Sandbox(World(), services=["wiki"]) as first, pytest.raises(LimitReached) as stopped:
        crawl(at(first, limit=1), names)
    summary = stopped.value.summary
    assert (summary["crawled"], summary["pending"], stopped.value.exit_code) == (1, 3, 3)
    assert [row["title"] for row in tables(at(first))["pages"]] == ["Lamp buoy"]
    pending = pq.read_table(tmp_path / "data/clean/wiki/pending")["reason"].to_pylist()
    assert pending == ["render"] * 3
    with Sandbox(World(), services=["wiki"]) as second:
        run = at(second)
        summary = crawl(run, names)
        assert summary["crawled_in_all"] == len(FEW)
        assert (summary["rejected"], summary["failed"]) == (0, 0)
        assert summary["images_failed"] == 0

    def without_ports(found):
        return re.sub(r"127\.0\.0\.1:\d+", "wiki", repr(found))

    assert without_ports(tables(run)) == without_ports(of_few(whole[2]))


def emptied(path):
    path.write_bytes(b"")


def changed(path):
    data = bytearray(path.read_bytes())
    data[len(data) // 2] ^= 4
    path.write_bytes(data)


@pytest.fixture
def copied(whole, make_run, tmp_path):
    """A copy of the whole crawl, filtered."""
    shutil.copytree(whole[0].root, tmp_path / "data")
    return make_run(tmp_path / "data")


@pytest.mark.parametrize("damage", [emptied, changed])
def test_lost_images_and_captures_are_asked_for_again(whole, copied, damage):
    """As the advice says: crawl, filter, and all is as it was."""
    root, found = copied.root, whole[2]
    sprites = {
        (row["page_id"], row["element_id"]) for row in found["elements"] if row["kind"] == "sprite"
    }
    sprite = next(
        row["path"]
        for row in found["images"]
        if (row["page_id"], row["element_id"]) in sprites and row["path"]
    )
    original = next(row["path"] for row in found["images"] if (row["path"] or "").endswith(".jpg"))
    shot = found["pages"][0]["screenshot_path"]
    tar_shards.export(copied)
    released = {path.name: path.read_bytes() for path in root.glob("release/wiki/*.tar")}
    for path in (sprite, original, shot):
        damage(root / path)
    for write in (tar_shards.export, minedojo.wiki):
        with pytest.raises(DamagedData, match=r"is (empty|not there|not what was)") as told:
            write(copied)
        assert told.value.hint.startswith("run `kb wiki crawl`")
    assert not list(root.glob("export/minedojo/*"))
    assert {path.name: path.read_bytes() for path in root.glob("release/wiki/*.tar")} == released
    summary = crawl(copied)
    assert (summary["images_failed"], summary["failed"]) == (0, 0)
    assert summary["requests"] > 0
    assert tables(copied) == found
    tar_shards.export(copied)
    assert {path.name: path.read_bytes() for path in root.glob("release/wiki/*.tar")} == released
    assert crawl(copied)["requests"] == 0


def test_verify_finds_them_and_a_crawl_after_repair_has_them_again(whole, copied, sandbox):
    root = copied.root
    tar_shards.export(copied)
    assert verify(root, Progress()).entries == []
    shots = sorted(root.glob("raw/wiki/pages/*/*/screenshot.png"))
    pictures = sorted(root.glob("raw/wiki/images/*"))
    segment = next(root.glob("raw/wiki/files/*.zst"))
    emptied(shots[0])
    shots[1].unlink()
    for path in (*pictures[:2], segment):
        changed(path)
    pictures[2].unlink()
    look = verify(root, Progress())
    assert {(one.state, one.path) for one in look.entries} == {
        ("missing", shots[1]),
        ("missing", pictures[2]),
        *(("damaged", path) for path in (shots[0], *pictures[:2], segment)),
    }
    asked = len(sandbox.ledger)
    said = Recipe("verify").defined("repair")(copied)[1]
    assert len(sandbox.ledger) == asked
    assert "`kb wiki crawl` fetches 5 captured files again" in said
    crawl(copied)
    assert tables(copied) == whole[2]
    assert verify(root, Progress()).entries == []


@pytest.mark.parametrize("damage", [changed, Path.unlink])
def test_a_lost_extraction_is_told_by_the_filter_and_captured_again(whole, copied, damage):
    (path, *_) = sorted(copied.root.glob("raw/wiki/pages/*/*/extraction.json.zst"))
    damage(path)
    with pytest.raises(DamagedData, match=rf"{path.name} can't be read") as told:
        run_clean(copied, "wiki")
    assert told.value.hint.startswith("run `kb wiki crawl`")
    crawl(copied)
    assert tables(copied) == whole[2]


@pytest.mark.parametrize("damage", [changed, Path.unlink])
def test_a_lost_description_of_the_wiki_is_asked_for_again(whole, copied, damage):
    """Licence and history of every page come from it, so that it must not stay away unseen."""
    (segment,) = copied.root.glob("raw/wiki/site/*.zst")
    damage(segment)
    with pytest.raises(DamagedData, match=re.escape(segment.name)):
        run_clean(copied, "wiki")
    with pytest.raises(DamagedData, match=re.escape(segment.name)) as told:
        crawl(copied)
    assert str(told.value).endswith("lost are the answers of site answered"), "and no other"
    # the page that names the API, the description
    assert crawl(copied)["requests"] == 2
    assert tables(copied) == whole[2]


def test_a_lost_state_is_made_of_raw_data_without_asking_for_pages_or_files(whole, copied):
    for path in copied.root.glob("state/wiki.sqlite*"):
        path.unlink()
    summary = crawl(copied)
    assert summary["crawled"] == 0
    assert summary["requests"] < 10, "the lists, no revision and no image"
    assert tables(copied) == whole[2]


@pytest.fixture(scope="module")
def crawled_later(whole, sandbox, tmp_path_factory):
    """(run, summary): the whole crawl, and the changes of the later state."""
    root = tmp_path_factory.mktemp("later") / "data"
    shutil.copytree(whole[0].root, root)
    run = dataclasses.replace(whole[0], root=root, again=True)
    sandbox.world.wiki_state = "later"
    try:
        return run, crawl(run)
    finally:
        sandbox.world.wiki_state = "first"


@pytest.fixture
def later(crawled_later, tmp_path):
    """A run on a copy of it, on the wiki of the first state."""
    run, _ = crawled_later
    shutil.copytree(run.root, tmp_path / "data")
    return dataclasses.replace(run, root=tmp_path / "data")


def test_later_state_leaves_tombstones(whole, crawled_later, later):
    run = later
    assert crawled_later[1]["crawled"] == 4
    found = {row["title"]: row["page_id"] for row in tables(run)["pages"]}
    assert {"Charts", "Lamp buoy"}.isdisjoint(found)
    assert (found["Lamp float"], found["New jetty"]) == (28, 32)
    assert tombstones.keys(run.root, "wiki") == {"24", "Lamp buoy"}
    # Deleted pages can come back, and pages be moved back: what the wiki shows again is shown
    # again.
    crawl(run)
    assert tables(run) == whole[2]
    assert tombstones.keys(run.root, "wiki") == {"32", "Lamp float"}


def test_what_was_purged_after_its_deletion_stays_away_for_good(whole, later):
    run = later
    assert Recipe("purge").defined("purge")(run, "wiki", None)["also"] == 1
    for _ in range(2):
        crawl(run)
        assert {row["page_id"] for row in tables(run)["pages"]} == {
            row["page_id"] for row in whole[2]["pages"]
        } - {24}
        assert "24" in tombstones.keys(run.root, "wiki")


def test_page_that_hangs_is_tried_as_often_as_asked_and_recorded(
    make_run, faults, tmp_path, monkeypatch
):
    names = tmp_path / "titles.txt"
    names.write_text("Charts\nSaltstone\n")
    # It waits for good, and takes no core until it is ended.
    waits = 'const asked = new XMLHttpRequest(); asked.open("GET", "/held", false); asked.send();'
    faults.add("/held", hold=True, times=None, then=lambda seen: hanging.release())
    faults.add(
        "/wiki/Charts",
        times=None,
        status=200,
        body=f"<!DOCTYPE html><script>{waits}</script>",
        headers={"Content-Type": "text/html"},
    )
    hanging, limits, go = threading.Semaphore(0), [], Browser.go

    def end_soon(browser, seconds):
        hanging.acquire()
        limits.append(seconds)
        browser.allow(0.01)

    def watched(browser, url):
        """Once the page hangs, its time is as good as over."""
        if url.endswith("/Charts"):
            seconds = browser._timer.interval
            threading.Thread(target=end_soon, args=(browser, seconds), daemon=True).start()
        go(browser, url)

    monkeypatch.setattr(Browser, "go", watched)
    run = make_run(tmp_path / "data", wiki={"max_tries": 2})
    assert crawl(by_two(run), names)["failed"] == 1
    assert limits == [run.profile.wiki.page_seconds + LAST_SECONDS] * 2
    found = tables(run)
    assert [row["title"] for row in found["pages"]] == ["Saltstone"]
    assert found["rejected"] == []
    assert [(row["key"], row["reason"]) for row in found["failed"]] == [("24", "page_timeout")]
    monkeypatch.setattr(Browser, "go", go)
    faults.clear()
    assert crawl(run, names)["failed"] == 0
    assert {row["title"] for row in tables(run)["pages"]} == {"Saltstone", "Charts"}


def test_robots_and_crawl_delay(make_run, faults, tmp_path, sandbox, turns, hasty):
    names = tmp_path / "titles.txt"
    names.write_text("Charts\nFog\n")
    faults.add(
        "/robots.txt",
        times=None,
        status=200,
        body="User-agent: *\nDisallow: /wiki/Charts\nCrawl-delay: 1\n",
    )
    run = make_run(tmp_path / "data")
    start = len(sandbox.ledger.requests(""))
    crawl(by_two(run), names)
    asked = sandbox.ledger.requests("")[start:]
    assert not [seen for seen in asked if seen.path == "/wiki/Charts"]
    paced = [seen.time for seen in asked if seen.path.startswith(("/wiki/", "/w/api.php"))]
    assert len(paced) > 3  # with the page that the wiki's root is
    assert turns.before(1, paced), "a second between any two, whoever sends them"
    assert ("24", "robots", "disallowed") in {
        (row["key"], row["stage"], row["reason"]) for row in tables(run)["rejected"]
    }


def test_unreachable_wiki_is_resumable(make_run, sandbox, tmp_path, monkeypatch):
    monkeypatch.setattr("kb.wiki.crawl.http_client.TRIES", 2)
    run = make_run(tmp_path)
    sandbox.servers["wiki"].stop()
    try:
        with pytest.raises(Unreachable):
            crawl(run)
    finally:
        sandbox.servers["wiki"].start()
    assert not list(rawlog.envelopes(tmp_path, "wiki", "renders"))


def test_another_wiki_needs_another_data_root(whole, run_on):
    with pytest.raises(OtherService):
        crawl(run_on(whole[0].root, "https://elsewhere.example"))


def test_usage_errors_come_first(make_run, tmp_path, monkeypatch):
    run = make_run(tmp_path / "data")
    with pytest.raises(SettingError, match="can't be read"):
        crawl(run, tmp_path / "absent.txt")
    fake = tmp_path / "bin"
    fake.mkdir()
    monkeypatch.setenv("PATH", str(fake))
    monkeypatch.setenv("SE_CACHE_PATH", str(fake))
    with pytest.raises(MissingExtra, match="Chromium and chromedriver not found") as error:
        crawl(run)
    assert (error.value.exit_code, "apt-get install chromium" in error.value.hint) == (2, True)
    for name, version in (
        ("chromium", "Chromium 156.0.1"),
        ("chromedriver", "ChromeDriver 120.0.9"),
    ):
        (fake / name).write_text(f"#!/bin/sh\necho '{version}'\n")
        (fake / name).chmod(0o755)
    chromium._find.cache_clear()
    with pytest.raises(MissingExtra, match=r"version 120.0.9 and can't drive .* version 156.0.1"):
        crawl(run)
    chromium._find.cache_clear()
    assert not (tmp_path / "data" / "raw").exists()


def test_purge_leaves_nothing(whole, make_run, sandbox, tmp_path):
    """A named page leaves raw, clean, release and export, with the pictures that only it shows; the
    rest stays.
    """
    root = tmp_path / "data"
    shutil.copytree(whole[0].root, root)
    run = dataclasses.replace(whole[0], root=root)
    purge, export = Recipe("purge").defined("purge"), Recipe("wiki").defined("export")
    export(run, "wiki")
    export(run, "wiki", "minedojo")
    (tmp_path / "ids.txt").write_text("Net loom\n29\n")
    summary = purge(run, "wiki", tmp_path / "ids.txt")
    assert summary["purged"] == 2
    assert tombstones.keys(root, "wiki") == {"22", "29"}
    # By its title once more: the same page, not another one.
    again = purge(run, "wiki", tmp_path / "ids.txt")
    assert again["unknown"] == 0
    assert tombstones.keys(root, "wiki") == {"22", "29"}
    left = {
        page["title"] for page in pq.read_table(next(root.glob("release/wiki/pages-*"))).to_pylist()
    }
    assert {"Net loom", "Long pier"}.isdisjoint(left)
    assert "Saltstone" in left
    for name, pages in (("recipes", set()), ("facts", {20})):  # Net loom's and Saltstone's
        for place in (root / "clean/wiki" / name, next(root.glob(f"release/wiki/{name}-*"))):
            assert set(pq.read_table(place)["page_id"].to_pylist()) == pages
    for path in root.rglob("*"):
        assert "Net_loom" not in path.name
    gone = {row["sha256"] for row in whole[2]["images"] if row["page_id"] == 22}
    assert not [path for path in (root / "raw/wiki/images").iterdir() if path.stem in gone]
    assert b"Net loom" not in b"".join(
        rawlog.encode(e)
        for kind in rawlog.kinds(root, "wiki")
        for e in rawlog.envelopes(root, "wiki", kind)
    )
    kept = [row for row in whole[2]["pages"] if row["page_id"] not in (22, 29)]
    assert tables(run)["pages"] == kept
    assert crawl(dataclasses.replace(run, again=True))["crawled"] == 0
    assert tables(run)["pages"] == kept


def test_a_wiki_that_refuses_us_is_no_fact_about_its_pages(make_run, faults, tmp_path):
    names = tmp_path / "titles.txt"
    names.write_text("Fog\n")
    run = make_run(tmp_path / "data")
    faults.add(
        "/wiki/", after=1, times=None, status=403
    )  # the front page still shows where the API is
    with pytest.raises(Challenged) as error:
        crawl(run, names)
    assert error.value.exit_code == 4
    assert crawl_left(run) == 1
    faults.clear()
    assert crawl(run, names)["crawled"] == 1


def crawl_left(run) -> int:

    frontier = Frontier(run.root / "state/wiki.sqlite", readonly=True)
    try:
        return frontier.counts("pages").get("todo", 0)
    finally:
        frontier.close()


def test_sigterm_finishes_the_page_in_hand(sandbox, few, faults, tmp_path):
    words = ["wiki", "crawl", "--data", str(tmp_path), "--workers", "1", "--json", "--quiet"]
    held = faults.add("/wiki/Charts", hold=True)
    process = processes.start(words, env=environment(sandbox), cwd=tmp_path)
    assert held.arrived.wait(60)
    family = psutil.Process(process.pid).children(recursive=True)
    assert family
    process.send_signal(signal.SIGTERM)
    held.release()
    out, _ = process.communicate(timeout=60)
    assert process.returncode == 3
    summary = json.loads(out.splitlines()[-1])
    assert summary["crawled"] >= 1
    assert summary["pending"] == len(FEW) - summary["crawled"]
    ended(family)
