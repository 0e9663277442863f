"""Every command that writes, killed at a few moments and run again; `make chaos` does it longer."""

from collections.abc import Iterator
from pathlib import Path

import pytest

from kb.store.rawlog import rawlog
from tests.conftest import skip_or_fail
from tests.crash import chaos, damaged, harm, worlds
from tests.crash.chaos import Trial
from tests.crash.worlds import Worlds

pytestmark = pytest.mark.crash

SEED = 14
# Once: they take longest.
ONCE = ("wiki crawl", "report", "restore", "purge", "annotate", "release", "index", "build")
LONGER = {  # `make chaos` alone
    *("youtube export --format=minedojo", "pairs --format=video2dataset", "build"),
    *("annotate reddit --workers=2", "pairs --again --workers=2"),
}
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
    *("pairs", "pairs --again", "links", "links --again", "release", "report", "restore"),
    *("verify --repair", "index --again", "release publish --publish"),
    *("reddit export --format=text", "youtube filter --workers=2"),
    "reddit import --workers=2",
    "build youtube reddit pairs tasks links release",
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
    count = 1 if name.startswith(ONCE) or "--" in name else 2
    result = chaos.kills(trial_of(made, name, tmp_path), count, SEED)
    assert result.said == []
    assert result.counts["right"] > 0


@pytest.mark.parametrize("name", ["youtube filter", "reddit export", "pairs --again"])
def test_joined_by_a_second_one_both_are_right(made: Worlds, name: str, tmp_path: Path) -> None:
    trial = trial_of(made, name, tmp_path)
    moment, wrong = trial.join("made", trial.whole("made")[1] // 2)
    assert moment
    assert wrong == []


@pytest.mark.parametrize(
    ("place", "kind"),
    [
        ("raw/youtube", "cut"),
        ("state/reddit", "empty"),
        ("annotations/youtube", "flip"),
        ("clean/youtube", "flip"),
        ("index/reddit", "flip"),
        ("pairs", "delete"),
        ("release/youtube", "cut"),
    ],
)
def test_damage_is_told_and_mended_or_has_no_effect(
    made: Worlds, place: str, kind: str, tmp_path: Path
) -> None:
    (found,) = [one for one in damaged.places(made.sources) if one.name == place]
    spoiled = damaged.Spoiled(made, found, tmp_path / "trial")
    file = max(spoiled.files, key=lambda path: (spoiled.base / path).stat().st_size)
    assert spoiled.came(kind, file, SEED, readers=1) == ("told", "repaired", [])


def test_a_killed_repair_keeps_every_intact_answer(made: Worlds, tmp_path: Path) -> None:
    trial = trial_of(made, "verify --repair", tmp_path)

    def lines(kind: str) -> set[bytes]:
        paths = rawlog.segments(trial.root, "reddit", kind)
        return {line for path in paths for _, line in rawlog.Frames(path, skip_damage=True)}

    length = 0
    for part in range(5):
        trial.fresh("made")
        found = trial.root.glob("raw/reddit/*/*.zst")
        path = max(found, key=lambda path: path.stat().st_size)
        worlds.flip(path)
        intact = lines(path.parent.name)
        # The last operations leave the record of a run whose repair is complete.
        ended = trial.run(harm.KILL, part * length // 6) if part else trial.run()
        assert ended.code == (-9 if part else 1), ended.err
        length = length or ended.operations
        assert trial.run().code == 1
        assert lines(path.parent.name) == intact
        assert list(path.parent.glob("*.damaged-*"))
        crawl = harm.run(("reddit", "crawl"), trial.env, trial.place)
        assert (crawl.code, lines(path.parent.name) > intact) == (0, True), crawl.err
        assert trial.run().code == 0


@pytest.mark.parametrize(
    ("first", "folder", "following"),
    [
        ("youtube filter", "clean/youtube", "youtube export"),
        ("youtube filter", "clean/youtube", "links"),
        ("pairs --again", "pairs", "pairs"),
        # A release refuses what a killed export has left: it is made again first.
        ("youtube export", "release/youtube", "build release"),
    ],
)
def test_the_next_command_restores_a_folder_that_was_being_replaced(
    made: Worlds, first: str, folder: str, following: str, tmp_path: Path
) -> None:
    trial = trial_of(made, first, tmp_path)
    trial.fresh("made")
    files = {path.name for path in (trial.root / folder).rglob("*.parquet")}
    place = trial.root / folder
    ended = trial.run(harm.KILL, at=f".{place.name}.new {place}")
    assert (ended.code, bool(ended.moment)) == (-9, True)
    assert not (trial.root / folder).exists()
    done = harm.run([*following.split(), "--quiet"], trial.env, trial.place)
    assert done.code == 0, done.err
    assert files <= {path.name for path in (trial.root / folder).rglob("*.parquet")}


@pytest.mark.parametrize("name", ["youtube filter", "pairs --again", "purge youtube"])
def test_a_purge_leaves_nothing_of_what_a_killed_command_wrote(
    made: Worlds, name: str, tmp_path: Path
) -> None:
    (purge,) = [case for case in made.cases if case.name == "purge youtube"]
    trial = trial_of(made, name, tmp_path)
    length = trial.whole("made")[1]
    for part in (1, 2, 3):
        trial.fresh("made")
        ended = trial.run(harm.KILL, part * length // 4)
        assert ended.code == -9
        done = harm.run(purge.words, trial.env, trial.place)
        assert done.code == 0, done.err
        assert chaos.leaked(trial.root, purge.gone) == []


def test_no_command_of_the_harness_is_missing_here(made: Worlds) -> None:
    assert {case.name for case in made.cases} <= {*NAMES, *LONGER}


def test_the_harness_sees_what_is_lost_leaked_and_left_over(made: Worlds, tmp_path: Path) -> None:
    trial = trial_of(made, "purge youtube", tmp_path)
    moment, wrong = trial.kill("made", 5, harm.KILL)
    assert moment
    assert wrong == []
    (trial.root / "clean" / ".youtube.new").mkdir()
    (trial.root / "clean" / ".youtube.new" / "part").write_bytes(trial.case.gone[0])
    next((trial.root / "clean" / "youtube" / "videos").glob("*.parquet")).unlink()
    assert {kind for kind, _ in trial.wrong("made")} == {"lost", "leaked", "left over"}
