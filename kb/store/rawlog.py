"""The raw log: service answers as they came, one envelope a line and a zstd frame.

    raw/<source>/<kind>/000001-1f2e3d4c.ndjson.zst         closed, never touched again
    raw/<source>/<kind>/000002-1f2e3d4c.ndjson.zst.open    being written

A frame is on disk (fsync) before the frontier hears of it. A segment that SIGKILL cut off is
cut back to its last whole frame when its writer starts again.
"""

from __future__ import annotations

import os
import re
import uuid
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import msgspec
import zstandard

from kb.core.errors import DamagedData
from kb.net import redact
from kb.store.atomic import full_disk_is_resumable, sync_folder

SUFFIX = ".ndjson.zst"
OPEN = SUFFIX + ".open"
SEGMENT_BYTES = 64 << 20
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


_encoder = msgspec.json.Encoder()
_decoder = msgspec.json.Decoder(Envelope)
_UNHOLDABLE = re.compile("[\x00\ud800-\udfff]")


def encode(envelope: Envelope) -> bytes:
    """The envelope as one line; NUL and lone surrogates become U+FFFD, a secret of ours "***", all else is verbatim."""
    return storable(envelope)[1]


def storable(envelope: Envelope) -> tuple[Envelope, bytes]:
    """What is kept of an envelope (the same object where that is all of it), and its line."""
    try:
        line = _encoder.encode(envelope)
        if b"\\u0000" not in line and not redact.holds_secret(line):
            return envelope, line + b"\n"
    except UnicodeEncodeError:
        pass
    params, response = _holdable(envelope.request.params), _holdable(envelope.response)
    kept = Envelope(
        envelope.fetched_at, Request(envelope.request.endpoint, params), envelope.status, response
    )
    return kept, _encoder.encode(kept) + b"\n"


def _holdable(value: Any) -> Any:
    if isinstance(value, str):
        return redact.literal(_UNHOLDABLE.sub("�", value))
    if isinstance(value, dict):
        return {_holdable(key): _holdable(inner) for key, inner in value.items()}
    if isinstance(value, list):
        return [_holdable(inner) for inner in value]
    return value


def decode(line: bytes) -> Envelope:
    """The envelope of a line. Raises DamagedData."""
    try:
        return _decoder.decode(line)
    except (msgspec.DecodeError, msgspec.ValidationError) as error:
        raise DamagedData(f"a raw line is no envelope: {error}") from None


class Frames:
    """The whole frames of a segment, in order, as (offset behind the frame, line).

    After the iteration `good` is the offset behind the last whole frame and `torn` tells
    whether bytes follow it. Works on a segment that is still being written.
    """

    def __init__(self, path: Path, start: int = 0) -> None:
        self.path, self.good, self.torn = path, start, False

    def __iter__(self) -> Iterator[tuple[int, bytes]]:
        engine = zstandard.ZstdDecompressor(max_window_size=1 << 31)
        with self.path.open("rb") as file:
            file.seek(self.good)
            rest = file.read(_CHUNK)
            while rest:
                frame, parts, used = engine.decompressobj(), [], 0
                while rest:
                    try:
                        parts.append(frame.decompress(rest))
                    except zstandard.ZstdError:
                        self.torn = True
                        return
                    used += len(rest) - len(frame.unused_data)
                    rest = frame.unused_data
                    if frame.eof:
                        break
                    rest = file.read(_CHUNK)
                if not frame.eof:
                    self.torn = True
                    return
                self.good += used
                yield self.good, b"".join(parts)
                rest = rest or file.read(_CHUNK)


def folder(root: Path, source: str, kind: str) -> Path:
    """Where the segments of a kind are."""
    return root / "raw" / source / kind


def kinds(root: Path, source: str) -> list[str]:
    """The kinds of answers that a source has on disk."""
    base = root / "raw" / source
    return sorted(path.name for path in base.iterdir() if path.is_dir()) if base.is_dir() else []


def segments(root: Path, source: str, kind: str) -> list[Path]:
    """All segments of a kind, oldest first, the open ones too."""
    base = folder(root, source, kind)
    found = (
        [path for path in base.iterdir() if path.name.endswith((SUFFIX, OPEN))]
        if base.is_dir()
        else []
    )
    return sorted(found, key=lambda path: base_name(path))


def base_name(path: Path) -> str:
    """The name of a segment, the same while open and when closed."""
    return path.name.removesuffix(".open").removesuffix(SUFFIX)


def read(root: Path, source: str, kind: str) -> Iterator[Envelope]:
    """Every envelope of a kind, oldest first; a torn tail is left out."""
    for path in segments(root, source, kind):
        for _, line in Frames(path):
            yield decode(line)


def any_answer(root: Path, source: str) -> bool:
    """Whether a source has a whole answer on disk."""
    return any(
        True
        for kind in kinds(root, source)
        for path in segments(root, source, kind)
        for _ in Frames(path)
    )


class Segment:
    """The open segment of one kind. Only its source's one writer makes it."""

    def __init__(self, base: Path) -> None:
        base.mkdir(parents=True, exist_ok=True)
        self._base = base
        self._compressor = zstandard.ZstdCompressor(level=3)
        self._file: Any = None
        self.path: Path | None = None
        self.size = 0

    def append(self, line: bytes, *, sync: bool = True) -> tuple[str, int]:
        """Write one frame and return (segment, offset behind it). Raises DiskFull.

        A frame that could only be written in part is cut away again.
        """
        with full_disk_is_resumable(self._base):
            if self._file is None:
                self._open()
            try:
                self._file.write(self._compressor.compress(line))
                self._file.flush()
                if sync:
                    os.fsync(self._file.fileno())
            except OSError:
                os.ftruncate(self._file.fileno(), self.size)
                raise
            self.size = self._file.tell()
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
        os.rename(self.path, self.path.with_name(self.path.name.removesuffix(".open")))
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


def recover(root: Path, source: str) -> list[str]:
    """Cut torn frames off open segments and close them; names of what was cut.

    Called under the writer's lock, before anything is written.
    """
    cut = []
    for kind in kinds(root, source):
        for path in segments(root, source, kind):
            if not path.name.endswith(".open"):
                continue
            frames = Frames(path)
            for _ in frames:
                pass
            if frames.torn:
                with path.open("r+b") as file:
                    file.truncate(frames.good)
                    os.fsync(file.fileno())
                cut.append(f"{kind}/{base_name(path)}")
            if frames.good == 0:
                path.unlink()
            else:
                os.rename(path, path.with_name(path.name.removesuffix(".open")))
            sync_folder(path.parent)
    return cut
