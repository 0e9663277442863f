"""Every command that writes, on a disk that is full: one line that names the folder and what is
free, what was there stays, and the same command finishes when there is room.

A disk is full in three ways: no space, no inodes, and a limit for the size of a file, which needs
no privilege.
"""

import re
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.crash import chaos, worlds
from tests.crash.test_chaos import LONGER, NAMES, trial_of
from tests.crash.worlds import Case, Worlds
from tests.store.full import SmallDisk

pytestmark = pytest.mark.crash

FULL = re.compile(r"kb: no space left to write (\S+)( \([^)]*\))?: (\S+) has [\d,.]+ MB .*free; ")
WAYS = {  # how much is left: bytes, files; or how large a file may be
    "full": (0, None),
    "nearly_full": (60_000, None),
    "no_inodes": (1 << 28, 0),
    "few_inodes": (1 << 28, 6),
}
LARGEST = 6_000


def more(made: Worlds) -> Iterator[Case]:
    """Commands that the harness for kills leaves out: what they write, they write in one step."""
    released, cache = str(made.place / "released"), {"XDG_CACHE_HOME": "data/cache"}
    downloaded = cache | {"KB_DATA": released}
    find = ("search", "the", "--json")
    yield Case(("index",), ("empty",), (), (find,), downloaded)
    yield Case(find, ("empty",), (), (find,), downloaded)
    yield Case(("tasks",), ("clean",), ("tasks",))
    yield Case(("label", "export", "pairs", "--out=data/labels-of"), ("made",), ("labels-of",))
    yield Case(("youtube", "export", "--format=text"), ("made",), ("export",))
    for suffix in ("csv", "json", "parquet"):
        sql = "SELECT range AS n, hash(range) AS h FROM range(20000)"
        yield Case(("query", sql, f"--out=data/found.{suffix}"), ("clean",), (".",))


MORE = [
    "index",
    "search the --json",
]


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Worlds]:
    sandbox, wiki = worlds.services()
    with sandbox:
        world = Worlds(tmp_path_factory.mktemp("made"), sandbox, wiki)
        world.cases += more(world)
        yield world


@pytest.fixture
def disk(tmp_path: Path) -> Iterator[SmallDisk]:
    small = SmallDisk(tmp_path / "disk")
    small.place.mkdir()
    with small.mounted():
        yield small


def said(ended: chaos.harm.Ended) -> str:
    """What is wrong with how a command ended on a full disk."""
    lines = [line for line in ended.err.splitlines() if line.startswith("kb: ")]
    if ended.code == 3 and len(lines) == 1 and FULL.match(lines[0]):
        return ""
    return f"{ended.code}: {lines or ended.err[-2000:]}"


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("name", [name for name in NAMES if name not in LONGER])
def test_on_a_full_disk(made: Worlds, name: str, way: str, disk: SmallDisk) -> None:
    trial = trial_of(made, name, disk.place)
    base = trial.case.bases[-1]
    trial.whole(base)
    disk.leave(1 << 28)
    trial.fresh(base)
    disk.leave(*WAYS[way])
    ended = trial.run()
    disk.leave(1 << 28)
    assert ended.code == 0 or said(ended) == ""
    assert trial.again() == []
    assert trial.wrong(base) == []
