"""Files and folders appear whole or not at all."""

import errno
import subprocess
import sys

import pytest

from kb.core.errors import DiskFull
from kb.store import atomic
from kb.store.atomic import replacing_folder, settle_folder, write_text, writing


def test_a_failed_write_leaves_the_old_file_and_nothing_beside(tmp_path):
    write_text(tmp_path / "a", "old")
    with pytest.raises(RuntimeError), writing(tmp_path / "a") as temporary:
        temporary.write_text("half")
        raise RuntimeError
    assert (tmp_path / "a").read_text() == "old"
    assert [path.name for path in tmp_path.iterdir()] == ["a"]


def test_no_room_is_resumable(tmp_path):
    with pytest.raises(DiskFull) as error, writing(tmp_path / "a"):
        raise OSError(errno.ENOSPC, "No space left on device")
    assert error.value.exit_code == 4


def test_a_folder_takes_the_old_ones_place_whole(tmp_path):
    folder = tmp_path / "release"
    with replacing_folder(folder) as fresh:
        (fresh / "one").write_text("1")
    with pytest.raises(RuntimeError), replacing_folder(folder) as fresh:
        (fresh / "two").write_text("2")
        raise RuntimeError
    assert [path.name for path in folder.iterdir()] == ["one"]
    with replacing_folder(folder) as fresh:
        (fresh / "two").write_text("2")
    assert [path.name for path in folder.iterdir()] == ["two"]
    assert [path.name for path in tmp_path.iterdir()] == ["release"]


def test_a_swap_that_was_cut_off_between_the_renames_is_undone(tmp_path):
    (tmp_path / ".release.old").mkdir()
    (tmp_path / ".release.old" / "one").write_text("1")
    (tmp_path / ".release.new").mkdir()
    settle_folder(tmp_path / "release")
    assert [path.name for path in tmp_path.iterdir()] == ["release"]
    assert (tmp_path / "release" / "one").read_text() == "1"


def test_a_running_process_is_known_by_its_mark_and_an_ended_one_too() -> None:
    assert not atomic.has_ended(f".file.{atomic.mark()}.tmp")
    program = "from kb.store import atomic; print(atomic.mark())"
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=True
    )
    assert atomic.has_ended(f".file.{done.stdout.strip()}.tmp")
    assert not atomic.has_ended("no mark")
