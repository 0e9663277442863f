"""Archive dumps: which files they are, and their lines, a post or comment each, of one subreddit or
of all.

A file comes as chunks of whole lines, whatever container it is; kb.reddit.dumps.search looks into
them. Containers are recognized by their first bytes, never by their names:

    zstd        frames with windows of up to 2^31, also several and skippable ones
    zst_blocks  uint32 size and a zstd frame, repeated; the content is a uint32 number of
                rows, (uint32 offset, uint32 size) of each, and the rows without line ends, all
                little-endian. Source: https://github.com/ArthurHeitmann/zst_blocks_format
    gzip        members one after the other
    plain       lines that begin with an object

A truncated or damaged file yields everything before the damage, and `ReadProgress` says so. What is
cut off or damaged is counted, never fatal.
"""

import gzip
import io
import json
import struct
import zlib
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import cache
from operator import add
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple

import orjson
import zstandard

from kb.core.errors import SettingError
from kb.core.regular_file import open_regular
from kb.crawl.file_identity import Hashed
from kb.reddit.parse import answer_tree

# Every chunk is searched several times, so it should fit the processor's cache (see tests/bench).
CHUNK = 512 << 10  # decompressed bytes of a chunk, about
_PIECE = 32 << 10  # compressed bytes that are read at once; zstd expands them 10 to 30 times
_EXPANDED = 1 << 20  # bytes that hold most expanded pieces
_LARGEST = 256 << 20  # decompressed bytes of a block of zst_blocks; Arctic Shift's have about 1 MiB
_HEAD = 18  # bytes of the longest header of a zstd frame
_WORKSPACE = 32 << 20  # memory besides the window: a chunk and copies of it
_FRAME, _SKIPPED = b"\x28\xb5\x2f\xfd", b"\x2a\x4d\x18"
_PACKED = {  # what archives of earlier years and people use, and what unpacks it
    b"BZh": "bunzip2 -k",
    b"\xfd7zXZ\0": "unxz -k",
    b"]\0\0": "unlzma -k",
    b"PK\3\4": "unzip",
    b"7z\xbc\xaf": "7z x",
}
_GZIP, _BOM = b"\x1f\x8b\x08", b"\xef\xbb\xbf"
# A checksum stands at the end of a member or frame, behind records that were given already.
_UNSURE = " (the last records before it may be wrong: import an intact copy into a new data root)"


@dataclass
class ReadProgress:
    """Counts and problems of a dump that is being read."""

    lines: int = 0
    bad_lines: int = 0
    first_bad: int | None = None  # offset of the first of them in the decompressed file
    truncated: bool = False
    problem: str = ""
    stopped: bool = False  # on request, before the end
    sha256: str = ""  # of the file as it lies, once all of it was read, unless it was known before

    def count_damaged(self, number: int, first: int | None) -> None:
        """Count damaged lines, the first of which begins at `first`."""
        self.bad_lines += number
        if self.first_bad is None:
            self.first_bad = first


Read = Callable[[BinaryIO, ReadProgress], Iterator[bytes]]


def pieces(path: Path, progress: ReadProgress) -> Iterator[bytes]:
    """The decompressed bytes of a dump, about CHUNK at once, without a byte order mark.

    Raises SettingError for a file that is not a dump or can't be read.
    """
    first, read = True, _reader(path)
    with open_regular(path) as opened:
        hashed = Hashed(opened)
        source = opened if progress.sha256 else io.BufferedReader(hashed, 1 << 20)
        for piece in read(source, progress):
            yield piece.removeprefix(_BOM) if first else piece
            first = False
        if not (progress.sha256 or progress.truncated):  # nothing of it was left out
            progress.sha256 = hashed.sha256


def memory(path: Path) -> int:
    """Bytes that reading a dump takes: its first frame's window (2 GiB in the archives' zstd files)
    or its first block, and a decompressed chunk.
    """
    read = _reader(path)
    with open_regular(path) as file:
        if read is _of_blocks:
            file.seek(4)
        head = file.read(_HEAD)
        while head[1:4] == _SKIPPED and len(head) >= 8:
            file.seek(int.from_bytes(head[4:8], "little") - len(head) + 8, 1)
            head = file.read(_HEAD)
    try:
        frame = zstandard.get_frame_parameters(head)
    except zstandard.ZstdError:
        return _WORKSPACE
    if read is _of_blocks:
        return 2 * min(int(frame.content_size), _LARGEST) + _WORKSPACE
    return int(frame.window_size) + _WORKSPACE


def _reader(path: Path) -> Read:
    """What decompresses a file, by its first bytes."""
    try:
        with open_regular(path) as file:
            head = file.read(8)
            if head.startswith(_FRAME) or (head[1:4] == _SKIPPED and head[0] & 0xF0 == 0x50):
                return _of_zstd
            if head[4:] == _FRAME:
                return _of_blocks
            if head.startswith(_GZIP):
                return _of_gzip
            while head and not (text := head.removeprefix(_BOM).strip()):
                head = file.read(CHUNK)
            if not head or text.startswith(b"{"):
                file.seek(0)
                if file.readline(CHUNK).removeprefix(_BOM).strip() == b"{":
                    raise SettingError(
                        f"{path} is not a dump: its records take several lines each",
                        hint="write one a line, as `jq -c . FILE` does",
                    )
                return _of_plain
    except OSError as error:
        raise SettingError(
            f"cannot read {path}: {error.strerror}", hint="give paths of dumps that exist"
        ) from None
    unpack = next((command for mark, command in _PACKED.items() if head.startswith(mark)), None)
    raise SettingError(
        f"{path} is not a dump: it is neither zstd, zst_blocks nor gzip, and does not start with"
        " a JSON object",
        hint=f"unpack it first: {unpack} {path}"
        if unpack
        else "name RS_* and RC_* files, or files of one subreddit",
    )


def _of_plain(file: BinaryIO, progress: ReadProgress) -> Iterator[bytes]:
    while piece := file.read(CHUNK):
        yield piece


def _of_gzip(file: BinaryIO, progress: ReadProgress) -> Iterator[bytes]:
    with gzip.GzipFile(fileobj=file) as members:
        try:
            while piece := members.read1(CHUNK):
                yield piece
        except EOFError:
            progress.truncated, progress.problem = True, "the last gzip member is cut off"
        except (OSError, zlib.error) as error:
            progress.truncated, progress.problem = True, f"damaged gzip member: {error}{_UNSURE}"


def _of_blocks(file: BinaryIO, progress: ReadProgress) -> Iterator[bytes]:
    engine = zstandard.ZstdDecompressor(max_window_size=1 << 31)
    while head := file.read(4):
        size = int.from_bytes(head, "little")
        block = file.read(min(size, _LARGEST))
        try:
            rows, complete = _rows(engine, block)
        except zstandard.ZstdError as error:
            progress.truncated, progress.problem = True, f"damaged block: {error}"
            return
        step = max(1, len(rows) * CHUNK // (sum(map(len, rows)) + 1))
        for begin in range(0, len(rows), step):
            yield b"\n".join([*rows[begin : begin + step], b""])
        if len(block) < size or not complete:
            progress.truncated, progress.problem = True, "the last block is cut off"
            return


def _rows(engine: zstandard.ZstdDecompressor, block: bytes) -> tuple[list[bytes], bool]:
    """The rows of a block, and whether these are all. Raises ZstdError for a damaged one."""
    size = zstandard.frame_content_size(block)
    if size > _LARGEST:
        raise zstandard.ZstdError(f"it has {size} bytes")
    try:
        data = engine.decompress(block, max_output_size=_LARGEST)
    except zstandard.ZstdError:
        with engine.stream_reader(block) as reader:  # gives what comes before a cut
            data = reader.read(size if size >= 0 else _LARGEST)
    number = int.from_bytes(data[:4], "little")
    begin = 4 + 8 * number
    if len(data) < begin:
        return [], False
    places = struct.unpack_from(f"<{2 * number}I", data, 4)
    starts, sizes = places[::2], places[1::2]
    if sum(sizes) > _LARGEST:
        raise zstandard.ZstdError("its rows overlap")
    data, ends = data[begin:], list(map(add, starts, sizes))
    rows = [data[start:end] for start, end in zip(starts, ends, strict=True)]
    if max(ends, default=0) <= len(data):
        return rows, True
    return [row for row, end in zip(rows, ends, strict=True) if end <= len(data)], False


class _Ending:
    """A compressed file with a zero byte behind its end, with which no frame begins.

    The decompressor refuses it between two frames and takes it within one, so that it tells whether
    the last frame is whole; python-zstandard itself does not say.
    """

    def __init__(self, file: BinaryIO) -> None:
        self._file, self.over = file, False

    def read(self, size: int) -> bytes:
        data = self._file.read(size)
        if data or self.over:
            return data
        self.over = True
        return b"\0"


@cache
def _refusal() -> str:
    """What zstd says of a zero byte between two frames."""
    try:
        zstandard.ZstdDecompressor().stream_reader(b"\0").read(1)
    except zstandard.ZstdError as error:
        return str(error)
    return ""


def _of_zstd(file: BinaryIO, progress: ReadProgress) -> Iterator[bytes]:
    # glibc keeps freed blocks of up to this size from now on, instead of returning each one.
    bytes(4 * _EXPANDED)
    source = _Ending(file)
    engine = zstandard.ZstdDecompressor(max_window_size=1 << 31)
    reader = engine.stream_reader(
        source,  # type: ignore[arg-type]  # it calls no other method
        read_size=_PIECE,
        read_across_frames=True,
    )
    try:
        # read1 decompresses into what it returns: other ways copy all of it once or twice.
        while (piece := reader.read1(_EXPANDED)) and not source.over:
            yield piece
    except zstandard.ZstdError as error:
        if not source.over:
            progress.truncated, progress.problem = True, f"damaged frame: {error}{_UNSURE}"
            return
        if str(error) == _refusal():
            return
    progress.truncated, progress.problem = True, "the last frame is cut off"


DEEPEST = 200  # nested lists and objects; Reddit's records have about ten levels
LONGEST = 64 << 20  # bytes of a line; Reddit's longest records have some hundred thousand


class Chunk(NamedTuple):
    """Whole lines: data[begin:end], of which the first byte is at `offset` in the decompressed
    file. A part of a line may follow.
    """

    offset: int
    data: bytes
    begin: int
    end: int


def chunks(
    path: Path, progress: ReadProgress, skip: int = 0, goes_on: Callable[[], bool] = lambda: True
) -> Iterator[Chunk]:
    """Whole lines from decompressed offset `skip` on. Pieces are not copied; a line across two
    pieces is a chunk of its own.

    A last line without a line break is yielded if it is an object; otherwise the file is truncated
    and the line counts as damaged. A line of more than `LONGEST` bytes counts as damaged too and is
    not kept in memory. `goes_on` is called for every piece, also while skipping; when it returns
    false, `progress.stopped` is set and the iteration ends.
    """
    parts: list[bytes] = []  # a line that goes on in the next piece
    waiting = 0  # their bytes
    at = 0  # of the next byte to give
    for piece in pieces(path, progress):
        if not goes_on():
            progress.stopped = True
            return
        begin = max(0, skip - at - waiting)
        if begin:
            # Only the part of the piece from `skip` on is wanted; earlier parts lie before it.
            at, parts, waiting = at + waiting + min(begin, len(piece)), [], 0
        end = piece.rfind(b"\n", begin) + 1
        if end <= begin:
            parts.append(piece[begin:])
            waiting += len(parts[-1])
            if waiting > LONGEST:
                parts = []
            continue
        if waiting:
            begin = piece.find(b"\n") + 1
            size = waiting + begin
            if size > LONGEST:
                progress.lines += 1
                progress.count_damaged(1, at)
                yield Chunk(at + size, b"", 0, 0)  # everything up to here is read
            else:
                yield Chunk(at, b"".join((*parts, piece[:begin])), 0, size)
            at += size
        if begin < end:
            yield Chunk(at, piece, begin, end)
            at += end - begin
        waiting = len(piece) - end
        parts = [piece[end:]] if waiting else []
    rest = b"".join(parts)
    if waiting <= LONGEST and not rest.strip():
        return
    if read_object(rest) is not None:
        yield Chunk(at, rest + b"\n", 0, len(rest) + 1)
        return
    if not progress.truncated:
        progress.truncated, progress.problem = True, "the last line is cut off"
    progress.lines += 1
    progress.count_damaged(1, at)


def read_object(line: bytes) -> dict[str, Any] | None:
    """The object of a line; None when it is not an object, or nested so deeply that parsing could
    crash the process.
    """
    try:
        value = orjson.loads(line)
    except orjson.JSONDecodeError:
        try:
            # The standard library accepts lone surrogates, which real titles contain, and a byte
            # order mark.
            value = json.loads(line)
        except (ValueError, RecursionError):
            return None
    if not isinstance(value, dict):
        return None
    # Few brackets can't be nested deep, and counting them is quick.
    brackets = line.count(b"[") + line.count(b"{")
    return None if brackets > DEEPEST and _is_deeper(value, DEEPEST) else value


def records_of(value: dict[str, Any]) -> Iterable[dict[str, Any]]:
    """The posts and comments of a line: itself, or those of an answer of an API, which may be an
    archive's ({"data": […]}) or Reddit's own.
    """
    data = value.get("data")
    if "subreddit" in value or not isinstance(data, (dict, list)):
        return (value,)
    if isinstance(data, list):
        return [thing for thing in data if isinstance(thing, dict)]
    inner = (thing.data for thing in answer_tree.things(value) if thing.kind != "more")
    return [{**record, "replies": ""} if "replies" in record else record for record in inner]


def _is_deeper(value: Any, levels: int) -> bool:
    """Whether more than `levels` lists and objects stand within each other; without recursion."""
    level = [value] if isinstance(value, (dict, list)) else []
    for _ in range(levels):
        level = [
            inner
            for outer in level
            for inner in (outer.values() if isinstance(outer, dict) else outer)
            if isinstance(inner, (dict, list))
        ]
        if not level:
            return False
    return bool(level)


Dumps = Sequence[Path]  # archive files to read instead of asking Reddit
