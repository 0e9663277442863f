"""Whatever a library says on a full disk, it is one error, which names the folder and what is free;
every other error stays what it is.
"""

import errno
import resource
import signal
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest

from kb.core.errors import DamagedData, DiskFull, FatalError, Interrupted
from kb.sandbox.world import World
from kb.sandbox.youtube.films import write_films
from kb.search import tantivy_index
from kb.search.passage import Passage
from kb.store.atomic import replacing_folder, write_bytes, writing
from kb.store.damage import opening
from kb.store.exhausted import full_disk_is_resumable
from kb.store.state.frontier import Frontier
from kb.store.tables import parquet
from tests.store.full import SmallDisk

NUMBERS = np.random.default_rng(0).random(400_000)


def _table(folder: Path) -> None:
    with writing(folder / "rows.parquet") as path:
        parquet.write_file(path, pa.table({"n": NUMBERS}))


def _array(folder: Path) -> None:
    with writing(folder / "n.npy") as path, path.open("wb") as file:
        np.save(file, NUMBERS)


def _index(folder: Path) -> None:
    texts = (" ".join(map(str, part)) for part in NUMBERS[:60_000].reshape(-1, 30))
    passages = [
        Passage("post", f"t3_{number}", f"t3_{number}", "", text, "", None)
        for number, text in enumerate(texts)
    ]
    with replacing_folder(folder / "index") as fresh:
        tantivy_index.write_index(fresh, "", passages, lambda done: None, heap=30 << 20)


def _state(folder: Path) -> None:
    frontier = Frontier(folder / "state.sqlite")
    try:
        with frontier.transaction():
            for number in range(3_000):
                frontier.set_cursor(f"n{number}", "x" * 1_000)
    finally:
        frontier.close()


def _film(folder: Path) -> None:
    pytest.importorskip("av")
    write_films(World(n_channels=1, n_videos=1, n_posts=1, width=1, depth=1), folder / "films")


WRITERS = {"Arrow": _table, "NumPy": _array, "tantivy": _index, "SQLite": _state, "PyAV": _film}


@pytest.fixture
def disk(tmp_path: Path) -> Iterator[SmallDisk]:
    small = SmallDisk(tmp_path / "disk")
    small.place.mkdir()
    with small.mounted():
        write_bytes(small.place / "kept", b"kept")
        yield small


@pytest.mark.parametrize(("room", "files"), [(20_000, None), (0, None), (1 << 28, 0)])
@pytest.mark.parametrize("library", WRITERS)
def test_a_library_on_a_full_disk(
    library: str, room: int, files: int | None, disk: SmallDisk
) -> None:
    disk.leave(room, files)
    with pytest.raises(DiskFull, match=rf"{disk.place}\S* has .* MB.* free") as caught:
        WRITERS[library](disk.place)
    assert caught.value.exit_code == 4
    disk.leave(1 << 28)
    WRITERS[library](disk.place)
    assert (disk.place / "kept").read_bytes() == b"kept"


@pytest.mark.parametrize("library", WRITERS)
def test_a_library_that_may_write_no_large_file(library: str, tmp_path: Path) -> None:
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    assert signal.getsignal(signal.SIGXFSZ) == signal.SIG_IGN
    resource.setrlimit(resource.RLIMIT_FSIZE, (2_000, before[1]))
    try:
        with pytest.raises(DiskFull, match="the limit for the size of a file") as caught:
            WRITERS[library](tmp_path)
        assert "ulimit" in caught.value.hint
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    WRITERS[library](tmp_path)


@pytest.mark.parametrize("number", [errno.ENOSPC, errno.EDQUOT, errno.EFBIG])
@pytest.mark.parametrize("wrapped", [False, True])
def test_an_errno_says_it_also_behind_another_error(
    number: int, wrapped: bool, tmp_path: Path
) -> None:
    def fails() -> None:
        error = OSError(number, "words that nobody reads")
        if not wrapped:
            raise error
        with opening(tmp_path / "file", hint="none"):
            raise error

    with pytest.raises(DiskFull, match=str(tmp_path)), full_disk_is_resumable(tmp_path / "file"):
        fails()


@pytest.mark.parametrize(
    "error",
    [
        ValueError("No space left on device (os error 28)"),
        OSError("[Errno 28] No space left on device"),
        PermissionError(errno.EACCES, "Permission denied"),
        OSError(errno.EIO, "Input/output error"),
        DamagedData("no space left"),
        FatalError("no space left"),
        Interrupted("stopped"),
        KeyboardInterrupt(),
    ],
    ids=lambda error: type(error).__name__,
)
def test_where_there_is_room_every_error_stays_what_it_is(
    error: BaseException, tmp_path: Path
) -> None:
    with pytest.raises(type(error)) as caught, full_disk_is_resumable(tmp_path):
        raise error
    assert caught.value is error


@pytest.mark.parametrize("error", [OSError(errno.ENOSPC, ""), ValueError()], ids=["errno", "none"])
def test_the_place_that_is_full_is_named(error: Exception, disk: SmallDisk, tmp_path: Path) -> None:
    disk.leave(0)
    with (
        pytest.raises(DiskFull, match=f"write {disk.place}: "),
        full_disk_is_resumable(tmp_path, disk.place),
    ):
        raise error
