"""The raw log: service answers as they came, one envelope a line and a zstd frame.

    raw/<source>/<kind>/000001-1f2e3d4c.ndjson.zst         closed, never touched again
    raw/<source>/<kind>/000002-1f2e3d4c.ndjson.zst.open    being written

    raw/<source>/<kind>/….ndjson.zst.damaged-<offset>      what could not be read, set aside

A frame is on disk (fsync) before the frontier hears of it. A segment that SIGKILL cut off is
cut back to its last whole frame when its writer starts again; what the state has committed is
never cut (kb.store.rawlog.quarantine).
"""

import os
import re
import uuid
from collections.abc import Collection, Iterator
from pathlib import Path
from typing import Any, BinaryIO

import msgspec
import zstandard

from kb.core.errors import DamagedData
from kb.net import redact
from kb.schema import raw
from kb.schema.decode import holdable
from kb.store.atomic import append, sync_folder
from kb.store.damage import open_file
from kb.store.exhausted import full_disk_is_resumable
from kb.store.layout import Layout
from kb.store.walk import walk

SUFFIX = ".ndjson.zst"
OPEN = SUFFIX + ".open"
SEEDS = "seeds"  # the raw kind of what lists named: no answers, but what a replay has to know
SEGMENT_BYTES = 64 << 20
MAGIC = b"\x28\xb5\x2f\xfd"
_WINDOW = 1 << 29
_CHUNK = 1 << 16  # small, as the rest of a chunk is copied once for each frame in it


class Request(msgspec.Struct):
    """What was asked, without any secret."""

    endpoint: str
    params: dict[str, Any]


class Envelope(msgspec.Struct):
    """One answer of a service. `fetched_at` is null only for dumps that don't say when."""

    fetched_at: str | None
    request: Request
    status: int
    response: Any


class _Outline(msgspec.Struct):
    """An envelope whose response is checked for its form alone."""

    fetched_at: str | None
    request: Request
    status: int
    response: msgspec.Raw


_outline = msgspec.json.Decoder(_Outline)
_encoder = msgspec.json.Encoder()
_decoder = msgspec.json.Decoder(Envelope)


def encode(envelope: Envelope) -> bytes:
    """The envelope as one line; NUL and lone surrogates become U+FFFD, a secret of ours "***",
    all else is verbatim.
    """
    return storable(envelope)[1]


def storable(envelope: Envelope) -> tuple[Envelope, bytes]:
    """What is kept of an envelope (the same object where that is all of it), and its line."""
    try:
        line = _encoder.encode(envelope)
        if b"\\u0000" not in line and not redact.holds_secret(line):
            return envelope, line + b"\n"
    except UnicodeEncodeError:
        pass
    params, response = (
        holdable(part, redact.literal) for part in (envelope.request.params, envelope.response)
    )
    kept = Envelope(
        envelope.fetched_at, Request(envelope.request.endpoint, params), envelope.status, response
    )
    return kept, _encoder.encode(kept) + b"\n"


def decode(line: bytes) -> Envelope:
    """The envelope of a line. Raises DamagedData."""
    try:
        return _decoder.decode(line)
    except (msgspec.DecodeError, UnicodeDecodeError) as error:
        raise DamagedData(f"a raw line is not an envelope: {error}") from None


class Frames:
    """The readable frames of a segment, in order, as (offset behind the frame, line).

    After the last of them the iteration raises DamagedData where something could not be read, so
    that nobody takes what is damaged for what never was. With `skip_damage` it does not:
    damage is passed over, and reading goes on at the next whole frame. `start` is the offset of
    the frame in hand. After the iteration `good` is the offset behind the last readable frame,
    `torn` tells whether bytes follow it (no damage while a segment is open), and `damaged` lists
    the stretches (start, end) between readable frames that hold none. With `checked` a frame whose
    line is not an envelope counts as damaged too. Works on a segment that is still being written.
    """

    def __init__(
        self, path: Path, start: int = 0, *, skip_damage: bool = False, checked: bool = False
    ) -> None:
        self.path, self.start, self.good, self.torn = path, start, start, False
        self.damaged: list[tuple[int, int]] = []
        self._skip_damage, self._checked = skip_damage, checked

    def __iter__(self) -> Iterator[tuple[int, bytes]]:
        at = self.good
        with open_file(self.path) as file:
            for start, end, line in intact_frames(file, at):
                if self._checked and not _is_envelope(line):
                    continue
                if start > self.good:
                    self.damaged.append((self.good, start))
                self.start, self.good = start, end
                yield end, line
            self.torn = self.good < file.seek(0, os.SEEK_END)
        at_byte = self.first_damaged()
        if at_byte is None or self._skip_damage:
            return
        source = self.path.parent.parent.name
        raise DamagedData(
            f"{self.path} is damaged at byte {at_byte:,}",
            hint=f"run `kb {source} filter`, then `kb {source} crawl`: it moves damaged data"
            " away and fetches it again",
            paths=[self.path],
        )

    def first_damaged(self) -> int | None:
        """The first byte that could not be read, after the iteration; None: there is none."""
        if self.damaged:
            return self.damaged[0][0]
        return self.good if self.torn and not self.path.name.endswith(".open") else None


def _is_envelope(line: bytes) -> bool:
    try:
        _outline.decode(line)
    except (msgspec.DecodeError, UnicodeDecodeError):
        return False
    return True


def compressor() -> zstandard.ZstdCompressor:
    """What makes frames; their checksum tells a changed bit that would still be an answer."""
    return zstandard.ZstdCompressor(level=3, write_checksum=True)


def folder(root: Path, source: str, kind: str) -> Path:
    """Where the segments of a kind are."""
    return Layout(root).raw(source, kind)


def kinds(root: Path, source: str) -> list[str]:
    """The kinds of answers that a source has on disk. A folder that can't be read is one only if
    `schemas/` declares it: `lost+found` of a disk is none.
    """
    base = Layout(root).raw(source)
    _, folders, _ = next(walk(base, root, strict=False), (root, [], []))
    return [
        name
        for name in folders
        if not name.startswith(".")
        and (os.access(base / name, os.R_OK | os.X_OK) or f"{source}/{name}" in raw.kinds())
    ]


def segments(root: Path, source: str, kind: str) -> list[Path]:
    """All segments of a kind, oldest first, the open ones too."""
    base = folder(root, source, kind)
    if not base.is_dir():
        return []
    paths = (path for path in base.iterdir() if path.name.endswith((SUFFIX, OPEN)))
    # Hidden ones are on their way, or macOS's ._NAME beside NAME.
    return sorted((path for path in paths if not path.name.startswith(".")), key=base_name)


def all_segments(root: Path, source: str) -> list[Path]:
    """The segments of every raw kind of a source, kind after kind."""
    return [path for kind in kinds(root, source) for path in segments(root, source, kind)]


def base_name(path: Path) -> str:
    """The name of a segment, the same while open and when closed."""
    return path.name.removesuffix(".open").removesuffix(SUFFIX)


def envelopes(root: Path, source: str, kind: str) -> Iterator[Envelope]:
    """Every envelope of a kind, oldest first; the torn tail of an open segment is left out.

    Raises DamagedData, behind what can be read of a segment.
    """
    for path in segments(root, source, kind):
        for _, line in Frames(path):
            yield decode(line)


def any_answer(root: Path, source: str, but: Collection[str] = ()) -> bool:
    """Whether a source has answers on disk, readable or not, of other kinds than these."""
    # A closed segment held some, whatever is left of it; in an open one there may be none yet.
    return any(
        not path.name.endswith(".open")
        or next(iter(Frames(path, skip_damage=True)), None) is not None
        for path in all_segments(root, source)
        if path.parent.name not in (SEEDS, *but)
    )


class Segment:
    """The open segment of one kind. Only its source's one writer makes it."""

    def __init__(self, base: Path) -> None:
        with full_disk_is_resumable(base):
            base.mkdir(parents=True, exist_ok=True)
        self._base = base
        self._compressor = compressor()
        self._file: Any = None
        self.path: Path | None = None
        self.size = 0

    def append(self, *lines: bytes) -> tuple[str, int]:
        """Write a frame for each line, synced together; (segment, offset behind them).

        What could only be written in part is cut away again. Raises DiskFull.
        """
        frames = b"".join(map(self._compressor.compress, lines))
        with full_disk_is_resumable(self._base):
            if self._file is None:
                self._open()
            try:
                self.size = append(self._file, frames)
            except BaseException:
                if os.fstat(self._file.fileno()).st_size != self.size:
                    # A torn frame that can't be cut away is left for recorder.recover, which cuts
                    # open segments only: what follows goes into another segment.
                    self._file.close()
                    self._file = self.path = None
                    self.size = 0
                raise
        assert self.path is not None
        place = base_name(self.path), self.size
        if self.size >= SEGMENT_BYTES:
            self.close()
        return place

    def close(self) -> None:
        """Rename the segment to its final name."""
        if self._file is None or self.path is None:
            return
        os.fsync(self._file.fileno())
        self._file.close()
        if self.size:
            os.rename(self.path, self.path.with_name(self.path.name.removesuffix(".open")))
        else:  # of its first frame nothing could be written
            self.path.unlink()
        sync_folder(self._base)
        self._file = self.path = None
        self.size = 0

    def _open(self) -> None:
        numbers = [
            int(match[1])
            for path in self._base.iterdir()
            if (match := re.match(r"(\d{6})-", path.name))
        ]
        # The random part keeps the names of several machines apart when their folders are merged.
        self.path = self._base / f"{max(numbers, default=0) + 1:06d}-{uuid.uuid4().hex[:8]}{OPEN}"
        self._file = self.path.open("ab", buffering=0)
        self.size = 0
        sync_folder(self._base)


def intact_frames(file: BinaryIO, at: int) -> Iterator[tuple[int, int, bytes]]:
    """(start, end, content) of every whole frame from `at` on, whatever lies between them."""
    engine = zstandard.ZstdDecompressor(max_window_size=_WINDOW)
    file.seek(at)
    rest = file.read(_CHUNK)
    while rest:
        frame = _frame(engine, file, rest)
        if frame is None:
            following = _next_frame(file, at + 1)
            if following is None:
                return
            at = following
            file.seek(at)
            rest = file.read(_CHUNK)
            continue
        content, used, rest = frame
        yield at, at + used, content
        at += used
        rest = rest or file.read(_CHUNK)


def _frame(
    engine: zstandard.ZstdDecompressor, file: BinaryIO, rest: bytes
) -> tuple[bytes, int, bytes] | None:
    """A frame that begins with `rest`: content, size, and what was read behind it;
    None: damaged.
    """
    frame = engine.decompressobj()
    parts, used = [], 0
    while rest:
        try:
            parts.append(frame.decompress(rest))
        except zstandard.ZstdError:
            return None
        used += len(rest) - len(frame.unused_data)
        rest = frame.unused_data
        if frame.eof:
            return b"".join(parts), used, rest
        rest = file.read(_CHUNK)
    return None


def _next_frame(file: BinaryIO, at: int) -> int | None:
    """The offset of the next bytes that may begin a frame, at `at` or behind it."""
    file.seek(at)
    buffer = b""
    while chunk := file.read(_CHUNK):
        buffer += chunk
        place = buffer.find(MAGIC)
        if place >= 0:
            return at + place
        known = max(0, len(buffer) - len(MAGIC) + 1)
        at, buffer = at + known, buffer[known:]
    return None
