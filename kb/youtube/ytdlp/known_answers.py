"""What was imported before: an answer is known by what it says.

A file counts by the answers that are made of it. Those that the raw log has are not written again,
whatever the file is called and wherever it lies; so of several files of one name, size and time
none is lost, and a copy adds nothing. The videos that subtitles belong to are part of the answer:
two videos may say the same.

`state/youtube-import/files.stamps` notes which answers each file gave (kb.crawl.file_identity), so
that the next import of the same folder opens only what is new. A note counts as long as the raw log
has all of these answers; without the notes every file is read once more.
"""

import hashlib
from collections.abc import Iterable
from pathlib import Path

import msgspec

from kb.store.atomic import append
from kb.store.exhausted import full_disk_is_resumable
from kb.store.layout import Layout
from kb.store.rawlog import rawlog

_SIZE = 12  # bytes of a stamp and of a digest

_Note = tuple[bytes, bytes]
"""The stamp of a file, and the digest of an answer that it gave."""


class _Answer(msgspec.Struct):
    """Of an envelope, what it says."""

    response: msgspec.Raw


_decoder = msgspec.json.Decoder(_Answer)


def answer_digest(kind: str, line: bytes) -> bytes:
    """What tells an answer of a kind from any other, of its line in the raw log."""
    digest = hashlib.blake2b(kind.encode(), digest_size=_SIZE)
    digest.update(bytes(_decoder.decode(line).response))
    return digest.digest()


class KnownAnswers:
    """The answers in the raw log, and the files that gave them. Raises DamagedData."""

    def __init__(self, root: Path, kinds: Iterable[str]) -> None:
        self._root, self._path = root, Layout(root).importing("youtube") / "files.stamps"
        self._answers = {
            answer_digest(kind, line)
            for kind in kinds
            for path in rawlog.segments(root, "youtube", kind)
            for _, line in rawlog.Frames(path)
        }
        self._files = self._read_notes()
        self._unsaved: list[_Note] = []

    def _read_notes(self) -> set[bytes]:
        """The stamps of files all of whose answers are known."""
        try:
            data = self._path.read_bytes()
        except FileNotFoundError:
            return set()
        known, lost = set[bytes](), set[bytes]()
        for at in range(0, len(data) - 2 * _SIZE + 1, 2 * _SIZE):
            stamp, answer = data[at : at + _SIZE], data[at + _SIZE : at + 2 * _SIZE]
            (known if answer in self._answers else lost).add(stamp)
        return known - lost

    def has_file(self, stamp: bytes) -> bool:
        """Whether all that a file gave is in the raw log."""
        return stamp in self._files

    def add(self, stamp: bytes, answers: Iterable[bytes]) -> list[bool]:
        """Take in the answers of a file; which of them were not known."""
        fresh = []
        for answer in answers:
            fresh.append(answer not in self._answers)
            self._answers.add(answer)
            self._unsaved.append((stamp, answer))
        self._files.add(stamp)
        return fresh

    def save(self) -> None:
        """Note the files, whose answers must be on disk. Raises DiskFull."""
        if not self._unsaved:
            return
        self._path.parent.mkdir(parents=True, exist_ok=True)
        with full_disk_is_resumable(self._root), self._path.open("ab", buffering=0) as file:
            size = file.tell()
            file.truncate(size - size % (2 * _SIZE))  # what a killed import wrote in part
            append(file, b"".join(map(b"".join, self._unsaved)))
        self._unsaved = []
