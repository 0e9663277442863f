"""The raw segments of one dump: written beside their place, noted, then renamed."""

from __future__ import annotations

import hashlib
import os
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import msgspec

from kb.reddit.dumps import cursor as places
from kb.reddit.dumps.containers import Seen
from kb.reddit.dumps.cursor import KIND, DumpCursor
from kb.reddit.dumps.extract import Taken
from kb.store import rawlog
from kb.store.atomic import sync_folder
from kb.store.rawlog import Envelope, Request


class DumpSegments:
    """The segments of one dump; each appears whole."""

    def __init__(self, root: Path, file: Path, name: str, place: DumpCursor, size: int) -> None:
        self.place = place
        self._root, self._dump, self._name, self._most = root, file, name, size
        self._base = rawlog.folder(root, "reddit", KIND)
        self._base.mkdir(parents=True, exist_ok=True)
        self._engine = rawlog.compressor()
        self._digest = hashlib.sha256()
        self._file: Any = None

    @property
    def full(self) -> bool:
        """Whether the segment is large enough to be closed."""
        return self._file is not None and self._file.tell() >= self._most

    def write(self, things: list[Taken], offset: int) -> None:
        """One envelope, shaped like a Listing; `offset` is behind its last line, and orders what
        the dump says twice.
        """
        if not things:
            return
        if self._file is None:
            self._file, self._digest = (
                places.begun(self._base, self._name).open("wb"),
                hashlib.sha256(),
            )
        read = [thing.read for thing in things if thing.read is not None]
        envelope = Envelope(
            _stamp(max(read)) if read else None,
            Request(f"dump/{self._dump.name}", {"offset": offset}),
            200,
            {
                "kind": "Listing",
                "data": {"children": [msgspec.Raw(thing.line) for thing in things], "after": None},
            },
        )
        frame = self._engine.compress(rawlog.encode(envelope))
        self._digest.update(frame)
        self._file.write(frame)

    def close(self, offset: int, things: int, seen: Seen) -> None:
        """Note the place, then let the segment appear."""
        if self._file is not None:
            self._file.flush()
            os.fsync(self._file.fileno())
            self._file.close()
            self.place.segments += 1
            digest = self._digest.hexdigest()
            self.place.segment = places.segment_name(self.place.segments, digest)
            os.rename(
                places.begun(self._base, self._name), places.written(self._base, self.place.segment)
            )
        self.place.offset, self.place.lines = offset, seen.lines
        self.place.bad_lines, self.place.first_bad = seen.bad_lines, seen.first_bad
        self.place.things += things
        self.place.fresh += things
        places.save(self._root, self._name, self.place)
        if self._file is not None:
            os.rename(
                places.written(self._base, self.place.segment), self._base / self.place.segment
            )
            sync_folder(self._base)
        self._file = None


def _stamp(seconds: int) -> str:
    return datetime.fromtimestamp(seconds, UTC).strftime("%Y-%m-%dT%H:%M:%SZ")
