"""Crawl, filter, export and `kb status` of one data root: the same nouns, the same numbers."""

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from kb.core.summary import Summary, vocabulary
from kb.wiki.browser import chromium
from tests.conftest import skip_or_fail
from tests.faults import Sandbox
from tests.small_worlds import ITEMS, small_world
from tests.youtube.job import Job

ANSWERS = ("crawled", "kept", "rejected", "failed", "pending", "missing")
ONE = {("wiki", "crawl"): ("--workers", "1")}  # a browser


class Done:
    """Summaries by step of one root on one sandbox, and what `kb status` says of it."""

    def __init__(self, sandbox: Sandbox, place: Path) -> None:
        self.job = Job(sandbox, place)
        self.steps = {
            (source, step): Summary(self.job.done(source, step, *ONE.get((source, step), ())))
            for source in ITEMS
            for step in ("crawl", "filter", "export")
        }
        self.status = self.job.done("status")
        self.text = self.job.kb("status").stdout

    def line(self, source: str, step: str) -> str:
        return self.steps[source, step].line()

    def block(self, source: str) -> str:
        """The lines of a source in `kb status`."""
        return next(part for part in self.text.split("\n\n") if part.startswith(source))


@pytest.fixture(scope="module")
def done(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Done]:
    try:
        chromium.find()
    except Exception as error:  # noqa: BLE001
        skip_or_fail(str(error))
    with Sandbox(small_world()) as sandbox:
        yield Done(sandbox, tmp_path_factory.mktemp("nouns"))


@pytest.mark.parametrize("source", ITEMS)
def test_the_four_answers_are_the_same_in_filter_and_status(done: Done, source: str) -> None:
    filtered, status = done.steps[source, "filter"], done.status["sources"][source]
    assert filtered["tally"] == status["tally"] != {}
    assert {name: filtered[name] for name in ANSWERS} == {name: status[name] for name in ANSWERS}
    for numbers in filtered["tally"].values():
        answered = (numbers[name] for name in ("kept", "rejected", "failed", "pending"))
        assert numbers["crawled"] == sum(answered)
    for counted, numbers in filtered["tally"].items():
        said = vocabulary.tally(counted, numbers)
        assert said in done.line(source, "filter")
        assert said in done.block(source)


@pytest.mark.parametrize("source", ITEMS)
def test_what_a_crawl_counts_is_what_its_filter_gets(done: Done, source: str) -> None:
    crawled, status = done.steps[source, "crawl"], done.status["sources"][source]
    numbers = done.steps[source, "filter"]["tally"][ITEMS[source]]
    assert crawled["counted"] == status["counted"] == ITEMS[source]
    assert crawled["crawled"] == numbers["crawled"] == status["crawled_so_far"] > 10
    assert crawled["missing"] == numbers["missing"]
    assert f"{crawled['crawled']:,} {ITEMS[source]} crawled" in done.line(source, "crawl")
    assert (crawled["left"], status["left"]) == (0, 0)
    assert (crawled["requests"], crawled.get("units", 0)) == (status["requests"], status["units"])


def test_comments_that_were_read_and_those_that_reddit_did_not_return(done: Done) -> None:
    read = done.steps["reddit", "crawl"]["comments"]
    numbers = done.steps["reddit", "filter"]["tally"]["comments"]
    assert read == numbers["crawled"] - numbers["missing"] > 100


@pytest.mark.parametrize("source", ITEMS)
def test_what_is_exported_is_what_was_kept(done: Done, source: str) -> None:
    exported, filtered = done.steps[source, "export"], done.steps[source, "filter"]
    released = done.status["sources"][source]["released"]
    kept = {name.partition("/")[2]: rows for name, rows in filtered["tables"].items()}
    kept.pop("transcripts", None)  # never released
    assert released == {name: exported[name] for name in kept} == kept
    for name, rows in kept.items():
        said = f"{rows:,} {'slots of recipes' if name == 'recipes' else name}"
        assert said in done.line(source, "export")
        assert said in done.block(source)


def test_phases_of_a_crawl_bear_the_nouns_of_its_summary(done: Done) -> None:
    youtube = done.steps["youtube", "crawl"]
    phases = done.status["sources"]["youtube"]["phases"]
    assert list(phases) == ["searches", "channels", "videos", "transcripts"]
    assert phases["channels"]["total"] == youtube["channels"]
    assert phases["transcripts"]["done"] == youtube["transcripts_asked"]
    files = done.status["sources"]["wiki"]["phases"]["image files"]
    assert files["done"] == done.steps["wiki", "crawl"]["images"]


def test_every_name_is_in_the_vocabulary_and_none_is_jargon(done: Done) -> None:
    for (source, step), summary in done.steps.items():
        for name in summary:
            assert vocabulary.word(name, f"{source} {step}"), name
        line = summary.line()
        assert line.startswith(f"{source} {step}: ")
        assert not re.search(
            r"\bthings\b|\bstubs?\b|\bbuckets?\b|\bsegments?\b|_", line.split(" in /")[0]
        )


def test_status_names_the_next_command_as_it_has_to_be_typed(done: Done) -> None:
    step = done.status["next"]
    assert step == ["kb pairs"]
    assert "next: kb pairs\n" in done.text
    elsewhere = done.job.kb("status", "--data", str(done.job.root)).stdout
    assert f"next: kb pairs --data {done.job.root}\n" in elsewhere


@pytest.mark.parametrize(
    ("summary", "line"),
    [
        ({"crawled": 1, "counted": "videos"}, "1 video crawled"),
        (
            {"crawled": 1200, "counted": "posts", "missing": 1},
            "1,200 posts crawled, 1 of them missing",
        ),
        ({"command": "x", "matches": 1, "units": 1, "failed": 0}, "x: 1 match, 1 quota unit"),
        ({"left_by": {"searches": 1, "videos": 54}}, "left: 1 search, 54 videos"),
        (
            {"crawled": 0, "counted": "pages", "stopped": "by SIGINT"},
            "0 pages crawled, stopped: by SIGINT",
        ),
    ],
)
def test_lines(summary: dict[str, Any], line: str) -> None:
    assert Summary(summary).line() == line
