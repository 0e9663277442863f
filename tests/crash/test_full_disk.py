"""Every command that writes, on a disk that is full: one line that names the folder and what is
free, what was there stays, and the same command finishes with the same bytes when there is room.

A disk is full in three ways: no space, no inodes, and a limit for the size of a file, which needs
no privilege. Of each the largest room is taken in which the command fails, so that it is far on its
way when it does.
"""

import re
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from tests.crash import harm, worlds
from tests.crash.chaos import Trial
from tests.crash.test_chaos import LONGER, NAMES, trial_of
from tests.crash.worlds import Case, Worlds
from tests.filters.made import digests
from tests.store.full import SmallDisk

pytestmark = pytest.mark.crash

FULL = re.compile(
    r"kb: (\w+: )?no space left to write .+: (/\S*) has [\d,]+\.\d MB( and no more files)? free"
)
ENOUGH = 1 << 28
WAYS = {  # how much is left, most first
    "space": (4 << 20, 1 << 20, 1 << 18, 1 << 16, 1 << 14, 0),  # bytes
    "inodes": (256, 64, 16, 4, 1, 0),
    "size": (1 << 20, 1 << 18, 1 << 16, 1 << 14, 1 << 12),  # bytes of the largest file
}
# They change many folders one after the other, or what is damaged.
IN_STEPS = ("purge", "verify", "refresh")


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Worlds]:
    sandbox, wiki = worlds.services()
    with sandbox:
        yield Worlds(tmp_path_factory.mktemp("made"), sandbox, wiki)


@pytest.fixture
def disk(tmp_path: Path, way: str) -> Iterator[SmallDisk]:
    small = SmallDisk(tmp_path / "disk")
    small.place.mkdir()
    if way == "size":
        yield small
        return
    with small.mounted():
        yield small


def failed(trial: Trial, base: str, way: str, disk: SmallDisk) -> harm.Ended | None:
    """The end of the command in the largest room in which it fails, with room again."""
    for room in WAYS[way]:
        if way == "size":
            trial.fresh(base)
            ended = trial.run(largest=room)
        else:
            disk.leave(ENOUGH)
            trial.fresh(base)
            disk.leave(*((room, None) if way == "space" else (ENOUGH, room)))
            ended = trial.run()
            disk.leave(ENOUGH)
        if ended.code:
            return ended
    return None


def told(ended: harm.Ended) -> None:
    """It ends with one line."""
    lines = [line for line in ended.err.splitlines() if line.startswith("kb: ")]
    assert (ended.code, len(lines)) == (4, 1), ended.err[-2000:]
    assert FULL.match(lines[0]), lines


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("name", [name for name in NAMES if name not in LONGER])
def test_a_command_that_finds_no_room_goes_on_later(
    made: Worlds, name: str, way: str, disk: SmallDisk
) -> None:
    if (name, way) == ("wiki crawl", "size"):
        pytest.skip("the limit would be the browser's too")
    trial = trial_of(made, name, disk.place / "trial")
    base = trial.case.bases[-1]
    whole, _ = trial.whole(base)
    if (ended := failed(trial, base, way, disk)) is None:
        assert way != "space", "it writes nothing"
        return
    told(ended)
    if trial.case.words[0] not in IN_STEPS:
        before = {
            f"{folder}/{one}": digest
            for folder in trial.case.same
            for one, digest in digests(made.base(base) / folder).items()
        }
        now = trial.outcome().bytes
        lost = {one for one in before.keys() & whole.bytes.keys() if now.get(one) is None}
        assert not lost
    assert trial.again() == []
    assert trial.wrong(base) == []


class Made:
    """A command whose output is not in a data root, or not compared by `Trial`."""

    def __init__(self, words: Callable[[Worlds], tuple[str, ...]], base: str, *made: str) -> None:
        self.words, self.base, self.made = words, base, made


def downloaded(made: Worlds) -> dict[str, str]:
    return {"KB_DATA": str(made.place / "released"), "XDG_CACHE_HOME": "cache"}


SQL = "SELECT range AS n, hash(range) AS h FROM range(40000)"
ALSO = {
    "index": Made(lambda made: ("index",), "empty"),
    "search": Made(lambda made: ("search", "the", "--json"), "empty"),
    "query csv": Made(lambda made: ("query", SQL, "--out=found.csv"), "clean", "found.csv"),
    "query json": Made(lambda made: ("query", SQL, "--out=found.json"), "clean", "found.json"),
    "query parquet": Made(
        lambda made: ("query", SQL, "--out=found.parquet"), "clean", "found.parquet"
    ),
    "tasks": Made(lambda made: ("tasks",), "clean", "data/tasks"),
    "label": Made(lambda made: ("label", "export", "pairs", "--out=judged"), "made", "judged"),
    "text": Made(lambda made: ("youtube", "export", "--format=text"), "made", "data/export"),
    "minedojo": Made(
        lambda made: ("youtube", "export", "--format=minedojo"), "made", "data/export"
    ),
    "video2dataset": Made(lambda made: ("pairs", "--format=video2dataset"), "made", "data/export"),
}


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("name", ALSO)
def test_what_is_written_elsewhere_too(
    made: Worlds, name: str, way: str, disk: SmallDisk, tmp_path: Path
) -> None:
    one = ALSO[name]
    env = downloaded(made) if name in ("index", "search") else {}
    case = Case(one.words(made), (one.base,), (), env=env)

    def outcome(trial: Trial) -> tuple[str, dict[str, str]]:
        ended = trial.run()
        assert ended.code == 0, ended.err[-2000:]
        found = harm.run(("search", "the", "--json"), trial.env, trial.place) if env else ended
        files = {
            str(path.relative_to(trial.place)): path.read_bytes()
            for place in one.made
            for path in [trial.place / place, *sorted((trial.place / place).rglob("*"))]
            if path.is_file() and path.name != "_manifest.json"
        }
        assert files or not one.made
        return (found.out if env else ""), {key: repr(data) for key, data in files.items()}

    unharmed = Trial(made, case, tmp_path / "unharmed")
    unharmed.fresh(one.base)
    wanted = outcome(unharmed)
    trial = Trial(made, case, disk.place / "trial")
    if (ended := failed(trial, one.base, way, disk)) is None:
        assert way != "space", "it writes nothing"
        return
    told(ended)
    assert outcome(trial) == wanted
