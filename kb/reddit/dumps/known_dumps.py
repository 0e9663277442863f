"""Which dump a file is: the one of a note in state/reddit-import/, or a new one.

Content decides, and a dump may have 100 GB. So it is read as seldom as possible:

    the very file     has a note of its own, named by its stamp (kb.crawl.file_identity): not a byte
                      of it is read
    another file      is another dump where its size or samples differ from those of every note:
                      4 MB are read. Only where they are equal, so that it is a copy in all
                      likelihood, its SHA-256 decides: all of it is read once, and noted
    a new dump        is hashed while it is imported, so that this costs no reading of its own

Samples alone never make two files one dump. A file that can't be told is imported: what is in the
raw data twice counts once.
"""

import hashlib
import math
from collections.abc import Iterable
from pathlib import Path

from msgspec.structs import replace

from kb.core import signals
from kb.core.context import Run
from kb.core.regular_file import open_regular
from kb.crawl.file_identity import file_stamp
from kb.reddit.dumps.cursor import (
    DumpCursor,
    cursors,
    find_cursor,
    save_cursor,
)
from kb.store.tables.checksums import digest

_START = 1 << 16  # bytes at the beginning of a dump that are compared
_SAMPLES, _SAMPLE = 1024, 4096  # samples after it, evenly spread over the file


def note_name(file: Path, since: float, until: float) -> str:
    """The name of the note of this very file, for a span of time."""
    return file_stamp(file, file.stat()).hex() + _span(since, until)


def _span(since: float, until: float) -> str:
    if (since, until) == (0.0, math.inf):
        return ""
    span = hashlib.sha256(f"{since}\0{until}".encode())
    return f"-{span.hexdigest()[:8]}"


def samples_of(file: Path) -> str:
    """A digest of samples of a dump."""
    size, computed = file.stat().st_size, hashlib.sha256()
    step = max(_SAMPLE, (size - _START - _SAMPLE) // (_SAMPLES - 1))
    with open_regular(file) as opened:
        computed.update(opened.read(_START))
        for at in (*range(_START, size - _SAMPLE, step), max(size - _SAMPLE, _START)):
            opened.seek(at)
            computed.update(opened.read(_SAMPLE))
    return computed.hexdigest()[:16]


class KnownDumps:
    """The dumps of one command, and those of the notes of its data root for the same span.

    `taken` are those of the command, by the names of their notes. With `--again` what was imported
    before does not count.
    """

    def __init__(self, run: Run, since: float, until: float) -> None:
        self._run, self._since, self._until = run, since, until
        self.taken: dict[str, DumpCursor] = {}
        span = _span(since, until)
        self._noted = [
            noted
            for name, noted in ({} if run.again else cursors(run.root)).items()
            if noted.sha256 and name.endswith(span) and ("-" in name) == bool(span)
        ]

    def take(self, file: Path) -> DumpCursor | None:
        """Take in a dump, unless it is the same as one of `taken`: then that is returned.

        Raises Interrupted, DiskFull.
        """
        root, name = self._run.root, note_name(file, self._since, self._until)
        if name in self.taken:
            return self.taken[name]
        noted = find_cursor(root, name)
        dump = noted or DumpCursor("")
        dump.file, dump.size = str(file.absolute()), file.stat().st_size
        dump.samples = dump.samples or samples_of(file)
        given = self._same(dump, self.taken.values())
        twin = given or (None if noted else self._same(dump, self._noted))
        if noted is None and twin is not None and twin.done:  # so that it is not hashed again
            save_cursor(root, name, replace(twin, file=dump.file))
        if given is None:
            self.taken[name] = dump
        return given

    def _same(self, dump: DumpCursor, others: Iterable[DumpCursor]) -> DumpCursor | None:
        """The dump among the others that has the same content."""
        for other in others:
            if (other.size, other.samples) == (dump.size, dump.samples):
                for unhashed in (file for file in (other, dump) if not file.sha256):
                    unhashed.sha256 = self._digest(Path(unhashed.file))
                if dump.sha256 == other.sha256:
                    return other
        return None

    def _digest(self, file: Path) -> str:
        size = file.stat().st_size
        with self._run.progress.task(f"compare {file.name}", total=size, unit="bytes") as task:

            def advance(read: int) -> None:
                task.advance(read)
                signals.stop.raise_if_asked()

            return digest(file, advance=advance)
