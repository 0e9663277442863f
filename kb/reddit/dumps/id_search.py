"""Records of dumps by their ids: of one subreddit, where all are known to be of it, or of any.

Ids are opaque: membership of a set decides, never their order. As in
kb.reddit.dumps.subreddit_search a whole chunk is searched before anything is parsed: the checksum
of the value behind every `"id":` is looked up in a table of bits, then the id itself; only lines
with a wanted id are parsed. Where all ids are of one subreddit, its lines are found as an import
finds them, at the same rate, and the id decides.

    ids/posts, comments, trees      sorted numbers of eight bytes, one an id
    ids/long                        ids that are longer, one a line
    ids/gone                        purged full names, which are never extracted
    ids/bits                        a bit for each checksum; at most one of 32 is set
"""

import mmap
from array import array
from bisect import bisect_left
from collections.abc import Collection, Iterable, Iterator, Sequence
from itertools import chain
from pathlib import Path
from typing import Any
from zlib import crc32

from kb.reddit.dumps.subreddit_search import SubredditSearch, finder
from kb.reddit.parse import answer_tree
from kb.store.atomic import replacing_folder, write_bytes

SIZE = 8  # bytes of an id that fits into a number; Reddit's have seven
POSTS, COMMENTS, TREES = "posts", "comments", "trees"
_OF = {answer_tree.POST: POSTS, answer_tree.COMMENT: COMMENTS}
_LONG, _GONE, _BITS = "long", "gone", "bits"
_FEWEST, _MOST = 20, 32  # the table's size as a power of two; a checksum has 32 bits


def write_index(
    names: Iterable[str], trees: Iterable[str], folder: Path, purged: Collection[str] = ()
) -> None:
    """Write full names, and bare ids of posts wanted with all comments, for `ById`.

    Names in `purged` are not wanted.
    """
    numbers = {kind: array("Q") for kind in (POSTS, COMMENTS, TREES)}
    sums, long = array("L"), set()
    for name in chain(names, (f"{TREES}_{key}" for key in trees)):
        if name in purged:
            continue
        prefix, _, key = name.partition("_")
        kind, value = _OF.get(prefix, TREES), key.encode()
        sums.append(crc32(value))
        if len(value) > SIZE:
            long.add(f"{kind} {key}")
        else:
            numbers[kind].append(int.from_bytes(value, "big"))
    width = min(_MOST, max(_FEWEST, (32 * len(sums)).bit_length()))
    bits = bytearray(1 << (width - 3))
    for one in sums:
        at = one >> (32 - width)
        bits[at >> 3] |= 1 << (at & 7)
    with replacing_folder(folder) as fresh:
        for kind, values in numbers.items():
            write_bytes(fresh / kind, array("Q", sorted(set(values))).tobytes())
        write_bytes(fresh / _LONG, "".join(f"{line}\n" for line in sorted(long)).encode())
        write_bytes(fresh / _GONE, "".join(f"{name}\n" for name in sorted(purged)).encode())
        write_bytes(fresh / _BITS, bytes(bits))


class IdIndex:
    """What `write_index` wrote into `folder`; processes share the memory of most of it."""

    def __init__(self, folder: Path) -> None:
        self._sorted = {kind: _numbers(folder / kind) for kind in (POSTS, COMMENTS, TREES)}
        self._long = frozenset((folder / _LONG).read_text().splitlines())
        self.purged = frozenset((folder / _GONE).read_text().splitlines())
        self.bits = _mapped(folder / _BITS)
        self.shift = 32 - (8 * len(self.bits) - 1).bit_length()
        self.trees = bool(self._sorted[TREES]) or any(line.startswith(TREES) for line in self._long)

    def has(self, kind: str, value: bytes) -> bool:
        """Whether an id is wanted as one of POSTS, COMMENTS or TREES."""
        if len(value) > SIZE:
            return f"{kind} {value.decode('utf-8', 'replace')}" in self._long
        number, among = int.from_bytes(value, "big"), self._sorted[kind]
        at = bisect_left(among, number)
        return at < len(among) and among[at] == number


class ById(SubredditSearch):
    """Finds posts and comments by id in chunks of a dump, and the comments of some posts.

    With a `subreddit` only its lines are searched.
    """

    def __init__(self, kept: IdIndex, subreddit: str = "") -> None:
        super().__init__(subreddit)
        self._kept, self._has = kept, kept.has
        self._ids = finder(b'"id":')
        self._links = finder(b'"link_id":') if kept.trees else None

    def _positions(self, data: bytes, begin: int, end: int) -> Iterable[int]:
        return super()._positions(data, begin, end) if self._name else self._any(data, begin, end)

    def _any(self, data: bytes, begin: int, end: int) -> Iterator[int]:
        """Positions of wanted ids of any subreddit, in order."""
        part = memoryview(data)[begin:end]
        hits = self._hits(data, begin, self._ids(part), 0, (POSTS, COMMENTS, TREES))
        if self._links is not None:
            hits += self._hits(data, begin, self._links(part), len("t3_"), (TREES,))
            hits.sort()
        yield from hits

    def _hits(
        self, data: bytes, begin: int, positions: Any, prefix: int, kinds: Sequence[str]
    ) -> list[int]:
        """Positions of wanted ids among the values behind colons, without their first `prefix`
        bytes.

        The loop runs for every line, so it calls few functions.
        """
        bits, shift, find = self._kept.bits, self._kept.shift, data.find
        hits = []
        for _, _, colon in positions:
            at = begin + colon + 1 + prefix
            if data[at - 1 - prefix] == 0x20:  # a space behind the colon
                at += 1
            value = data[at : find(b'"', at)]
            sum_ = crc32(value) >> shift
            if bits[sum_ >> 3] >> (sum_ & 7) & 1 and any(self._has(kind, value) for kind in kinds):
                hits.append(at)
        return hits

    def _takes(self, record: dict[str, Any]) -> bool:
        if self._name and not super()._takes(record):
            return False
        key = record.get("id")
        if not isinstance(key, str):
            return False
        own = key.encode("utf-8", "replace")
        if "title" in record:
            return self._has(POSTS, own) or self._has(TREES, own)
        post = answer_tree.bare(record.get("link_id")).encode("utf-8", "replace")
        return self._has(COMMENTS, own) or self._has(TREES, post)


def _numbers(path: Path) -> Sequence[int]:
    return memoryview(_mapped(path)).cast("Q")


def _mapped(path: Path) -> mmap.mmap | bytes:
    """A file's bytes, in memory that processes share."""
    if not path.stat().st_size:
        return b""
    with path.open("rb") as file:
        return mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ)
