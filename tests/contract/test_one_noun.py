"""Crawl, filter, export and `kb status` of one data root: the same nouns, the same numbers."""

import itertools
import json
import re
from typing import Any

import pytest

from kb.core.summary import Summary, phrases, vocabulary
from tests import processes
from tests.cli.conftest import clean_environment
from tests.conftest import needs
from tests.contract.conftest import NOW, Demo
from tests.small_worlds import ITEMS

needs("torch")

ANSWERS = ("crawled", "kept", "rejected", "failed", "pending", "missing")


class Done:
    """Summaries by step of one root, and what `kb status` says of it."""

    def __init__(self, made: Demo) -> None:
        words = ["status", "--data", str(made.root)]
        self.steps = {
            (source, step): Summary(made.steps[f"{source} {step}"])
            for source in ITEMS
            for step in ("crawl", "filter", "export")
        }
        environment = clean_environment() | {"KB_NOW": NOW}
        self.text = processes.run(words, env=environment, cwd=made.root).stdout
        told = processes.run([*words, "--json"], env=environment, cwd=made.root).stdout
        self.status = json.loads(told.splitlines()[-1])

    def line(self, source: str, step: str) -> str:
        return self.steps[source, step].line()

    def block(self, source: str) -> str:
        """The lines of a source in `kb status`."""
        _, _, below = self.text.partition(f"\n{source}\n")
        return "\n".join(itertools.takewhile(lambda line: line[:1] == " ", below.splitlines()))


@pytest.fixture(scope="module")
def done(cooking: Demo) -> Done:
    return Done(cooking)


@pytest.mark.parametrize("source", ITEMS)
def test_the_four_answers_are_the_same_in_filter_and_status(done: Done, source: str) -> None:
    filtered, status = done.steps[source, "filter"], done.status["sources"][source]
    assert filtered["tally"] == status["tally"] != {}
    assert {name: filtered[name] for name in ANSWERS} == {name: status[name] for name in ANSWERS}
    for numbers in filtered["tally"].values():
        answered = (numbers[name] for name in ("kept", "rejected", "failed", "pending"))
        assert numbers["crawled"] == sum(answered)
    for counted, numbers in filtered["tally"].items():
        said = phrases.tally(counted, numbers)
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
        said = phrases.nouns({name: rows})
        assert "_" not in said
        assert not rows or said in done.line(source, "export")
        assert said in done.block(source)


def test_phases_of_a_crawl_bear_the_nouns_of_its_summary(done: Done) -> None:
    youtube = done.steps["youtube", "crawl"]
    phases = done.status["sources"]["youtube"]["phases"]
    assert list(phases) == [
        "searches",
        "playlist searches",
        "playlists",
        "channels",
        "videos",
        "transcripts",
    ]
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
            r"\bthings\b|\bstubs?\b|\bbuckets?\b|\bsegments?\b|_",
            line.split(" in /")[0].replace("lorecrawl_tiny", ""),
        )


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
