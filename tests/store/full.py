"""Disks that are full: a file that takes so many bytes, and a real small file system."""

import contextlib
import os
import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest

KIND = "tmpfs"


class SmallDisk:
    """A file system at `place` whose room can be changed while it is in use."""

    def __init__(self, place: Path) -> None:
        self.place = place

    def leave(self, size: int, files: int | None = None) -> None:
        """Leave room for so many bytes and files more; None: for any number of files."""
        now = os.statvfs(self.place)
        used, there = (now.f_blocks - now.f_bfree) * now.f_frsize, now.f_files - now.f_ffree
        number = 1_000_000 if files is None else there + files
        self._mount("remount", used + size, number)

    def _mount(self, how: str, size: int, files: int) -> None:
        options = ",".join(filter(None, (how, f"size={max(4096, size)}", f"nr_inodes={files}")))
        subprocess.run(["mount", "-t", KIND, "-o", options, KIND, self.place], check=True)

    @contextlib.contextmanager
    def mounted(self) -> Iterator[None]:
        """Mount it for the block. Skips the test of who may not."""
        if os.geteuid() or os.uname().sysname != "Linux":
            pytest.skip("only root may mount a small file system")
        try:
            self._mount("", 1 << 30, 1_000_000)
        except (OSError, subprocess.CalledProcessError):
            pytest.skip("no file system can be mounted here")
        try:
            yield
        finally:
            subprocess.run(["umount", "--lazy", self.place], check=True)
