"""What other rooms learn from the source: status, plan, passages."""

from pathlib import Path

import pytest

from kb.core.config.profile import load_profile
from kb.core.config.settings import load_settings
from kb.core.context import Run
from kb.store.state.frontier import Frontier
from kb.youtube.crawl import quota
from kb.youtube.crawl.reduce import TRANSCRIPTS
from kb.youtube.parse.answers import PO_TOKEN
from kb.youtube.passages import LEAST, MOST, talk
from kb.youtube.status import status
from tests.youtube.crawl.test_fetch import CRAWL
from tests.youtube.job import Job


def test_units_of_all_days_and_what_is_left_of_today(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    profile = load_profile("minecraft")
    run = Run(load_settings(dotenv=False), profile, tmp_path)
    frontier = Frontier(tmp_path / "youtube.sqlite")
    monkeypatch.setenv("KB_NOW", "2026-11-19T12:00:00Z")
    section = profile.section("youtube")
    quota.quota(section, quota.GENERAL).spend(frontier, "videos.list", 1)
    monkeypatch.setenv("KB_NOW", "2026-11-20T12:00:00Z")
    for bucket in (quota.GENERAL, quota.SEARCH, quota.SEARCH):
        quota.quota(section, bucket).spend(frontier, "x", 1)
    frontier.add_keys(TRANSCRIPTS, ["a", "b"])
    frontier.skip(TRANSCRIPTS, "a", PO_TOKEN)
    found = status(run, frontier)
    frontier.close()
    assert (found["units"], found["po_token"]) == (4, 1)
    assert {name: one["spent"] for name, one in found["quota"].items()} == {
        quota.GENERAL: 1,
        quota.SEARCH: 2,
        quota.STATISTICS: 0,
    }
    assert all(one["spent"] + one["left"] == one["limit"] for one in found["quota"].values())
    assert {one["resets_at"] for one in found["quota"].values()} == {"2026-11-21T08:00:00Z"}


def test_a_plan_sends_nothing_and_is_what_the_crawl_costs(job: Job) -> None:
    job.done(*CRAWL, "--only", "channels")
    job.done(*CRAWL, "--only", "playlists")
    job.done(*CRAWL, "--only", "uploads")
    before = len(job.sandbox.ledger)
    plan = job.done(*CRAWL, "--plan")
    assert len(job.sandbox.ledger) == before
    used = job.sandbox.ledger.units()
    job.done(*CRAWL)
    assert plan["units"] == job.sandbox.ledger.units() - used


def test_windows_end_where_the_talk_pauses() -> None:
    words = " ".join(["word"] * 10)
    starts = [0.0, 3, 6, 9, 12, 15, 18, 25, 28, 31, 34, 37, 40, 43, 46, 49]
    said = talk(starts, [3.0] * 16, [words] * 16)
    found = list(said.windows())
    assert [starts[begin] for begin, _ in found] == [0.0, 25]  # before the pause from 21 to 25
    assert [n for begin, after in found for n in range(begin, after)] == list(range(16))
    even = talk([3.0 * n for n in range(100)], [3.0] * 100, [words] * 100).windows()
    sizes = [10 * (after - begin) for begin, after in even]
    assert sum(sizes) == 1000
    assert all(LEAST <= size <= MOST for size in sizes[:-1])


def test_cues_without_words_or_times_and_of_too_many_words() -> None:
    said = talk(
        [None, 1.0, -5.0, 20.0], [None, 2.0, 1.0, 10.0], ["", None, "a\nb ", "x " * (MOST + 1)]
    )
    assert said.texts[0] == "a b"
    assert [len(text.split()) for text in said.texts] == [2, MOST, 1]
    assert said.starts == [0.0, 20.0, round(20 + 10 * MOST / (MOST + 1), 2)]
    assert said.ends[-1] == 30.0
    assert list(talk([], [], []).windows()) == []
