"""Every command that writes, killed at a few moments and run again; `make chaos` does it longer."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.conftest import skip_or_fail
from tests.crash import chaos, harm, worlds
from tests.crash.chaos import Trial
from tests.crash.worlds import Worlds

pytestmark = pytest.mark.crash

SEED = 14
SECONDS = ("wiki crawl", "report", "restore", "purge", "annotate")  # once: they take longest
OF_SOURCES = [
    name
    for source in ("youtube", "reddit", "wiki")
    for name in (
        f"{source} crawl",
        f"annotate {source}",
        f"{source} filter",
        f"{source} export",
        f"purge {source}",
    )
]
NAMES = [
    *OF_SOURCES,
    *("reddit import", "refresh youtube", "refresh reddit", "reddit reconstruct"),
    *(
        "pairs",
        "pairs --again",
        "links",
        "links --again",
        "release",
        "report",
        "restore",
        "verify --repair",
    ),
    "profile new ferns",
]


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Worlds]:
    sandbox, wiki = worlds.services()
    with sandbox:
        yield Worlds(tmp_path_factory.mktemp("made"), sandbox, wiki)


def trial_of(made: Worlds, name: str, place: Path) -> Trial:
    found = {case.name: case for case in made.cases}
    if name not in found:
        skip_or_fail("there is no browser")
    return Trial(made, found[name], place / "trial")


@pytest.mark.parametrize("name", NAMES)
def test_killed_and_run_again_it_is_as_if_nothing_had_been(
    made: Worlds, name: str, tmp_path: Path
) -> None:
    result = chaos.kills(trial_of(made, name, tmp_path), 1 if name.startswith(SECONDS) else 2, SEED)
    assert result.said == []
    assert result.counts["right"] > 0


@pytest.mark.parametrize("name", ["youtube filter", "reddit export", "pairs --again"])
def test_joined_by_a_second_one_both_are_right(made: Worlds, name: str, tmp_path: Path) -> None:
    trial = trial_of(made, name, tmp_path)
    moment, wrong = trial.join("made", trial.whole("made")[1] // 2)
    assert moment
    assert wrong == []


def test_what_pairs_had_not_cleared_when_killed_goes_with_the_next_run(
    made: Worlds, tmp_path: Path
) -> None:
    trial = trial_of(made, "pairs", tmp_path)
    trial.whole("clean")
    left = trial.root / "state" / "pairs" / "0123"
    left.mkdir(parents=True)
    assert trial.again() == []
    assert not left.exists()


def test_no_command_of_the_harness_is_missing_here(made: Worlds) -> None:
    assert {case.name for case in made.cases} <= set(NAMES)


def test_the_harness_sees_what_is_lost_leaked_and_left_over(made: Worlds, tmp_path: Path) -> None:
    trial = trial_of(made, "purge youtube", tmp_path)
    moment, wrong = trial.kill("made", 5, harm.KILL)
    assert moment
    assert wrong == []
    (trial.root / "clean" / ".youtube.new").mkdir()
    (trial.root / "clean" / ".youtube.new" / "part").write_bytes(trial.case.gone[0])
    next((trial.root / "clean" / "youtube" / "videos").glob("*.parquet")).unlink()
    assert {kind for kind, _ in trial.wrong("made")} == {"lost", "leaked", "left over"}
