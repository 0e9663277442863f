"""Remove purged keys from the segments of the raw log, or count the answers that have them.

A segment is written again without the keys and takes the place of the old one by a rename. Frames
that may hold a key are found by searching their bytes; only these are decoded.
"""

from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import msgspec
from ahocorasick_rs import BytesAhoCorasick, Implementation

from kb.core import signals
from kb.core.context import Run
from kb.core.engine import make_executor, make_threads, map_in_order
from kb.schema import answer_keys as schema
from kb.store.atomic import followed, writing
from kb.store.damage import open_file
from kb.store.rawlog import quarantine, rawlog
from kb.store.rawlog.rawlog import Envelope, Request
from kb.store.state.frontier import Frontier

Names = Mapping[str, Collection[str]]
"""What is removed, by kind of name as `of` in `x-keys` calls it; "" has the keys."""

Strip = Callable[[str, Envelope, Names], "Envelope | None"]
"""(kind, envelope, names) → the envelope without the names.

The same object if it has none of them, None if nothing is left.
"""

Texts = Callable[[Collection[str]], Iterable[str] | None]
"""keys → texts of which one is in every answer with a key; None: any answer may have one."""

_ESCAPED = b"\\u"
_PARALLEL = 64 << 20  # bytes of segments that are worth worker processes, which take a second
_LARGE = 1 << 16  # bytes of all texts: a faster table of so many states takes dozens of MiB


class Matcher:
    """Says which of some texts a raw line may contain; with None for the texts, any.

    It never leaves one out that the line has. Lines are searched as `rawlog.encode` writes them; a
    line with an escaped character may contain anything. A text between other letters or digits
    doesn't count: short ids are parts of many words.
    """

    def __init__(self, texts: Iterable[str] | None) -> None:
        self._texts = {msgspec.json.encode(text)[1:-1]: text for text in texts or ()}
        self._any = texts is None or b"" in self._texts
        needles = sorted({*self._texts, _ESCAPED} - {b""})
        # Three times as fast as the library's own choice for more than a hundred texts.
        fast = Implementation.DFA if sum(map(len, needles)) < _LARGE else None
        self._find = BytesAhoCorasick(needles, implementation=fast)

    def __call__(self, line: bytes) -> bool:
        """Whether a line may contain one of the texts."""
        if self._any or not self._texts:
            return self._any
        find = self._find.find_matches_as_indexes
        return bool(find(line)) and any(
            _is_separate(line, start, end) for _, start, end in find(line, overlapping=True)
        )

    def texts(self, line: bytes) -> Collection[str]:
        """Those that a line may contain."""
        matches = self._find.find_matches_as_indexes(line, overlapping=True)
        present = {line[start:end] for _, start, end in matches if _is_separate(line, start, end)}
        if self._any or _ESCAPED in present:
            return self._texts.values()
        return {self._texts[text] for text in present}


def _is_separate(line: bytes, start: int, end: int) -> bool:
    if line[start:end] == _ESCAPED:
        return True
    inside = (start and line[start - 1 : start].isalnum()) or line[end : end + 1].isalnum()
    return not inside


def strip_by_schema(source: str, kind: str, envelope: Envelope, names: Names) -> Envelope | None:
    """A `Strip` that follows `x-keys` of the raw kind's schema."""
    request, response = envelope.request, envelope.response
    left = schema.without(f"{source}/{kind}", request.params, response, names)
    if left is None:
        return None
    params, answer = left
    if params is request.params and answer is response:
        return envelope
    return msgspec.structs.replace(
        envelope, request=Request(request.endpoint, params), response=answer
    )


@dataclass(frozen=True)
class AnswerRules:
    """How keys leave the raw answers of a source.

    texts     where to look for them
    names     of a purge under way, other names that leave the answers with its keys; also removes
              files and state that can only be found while the answers are complete
    strip     removes keys from an answer; None: as the schemas of the raw kinds say
    repeats   ids of rows that repeat some of what the answer shows of a key
    """

    texts: Texts = frozenset
    names: Callable[[Any], Names] | None = None
    strip: Strip | None = None
    repeats: Callable[[Envelope, Collection[str]], Iterable[str]] | None = None

    @property
    def in_order(self) -> bool:
        """Whether segments are written one after another, as `names` reads the last ones again."""
        return self.names is not None


def changed_frames(
    path: Path, matches: Matcher, strip: Callable[[Envelope], Envelope | None]
) -> Iterator[tuple[int, int, Envelope | None]]:
    """The frames (start, end) of a segment that change, and what is left of each envelope.

    Raises DamagedData after the last readable frame if some could not be read.
    """
    frames = rawlog.Frames(path, checked=True)
    for end, line in frames:
        if matches(line):
            envelope = rawlog.decode(line)
            left = strip(envelope)
            if left is not envelope:
                yield frames.start, end, left


def rewrite_segment(path: Path, changes: Iterable[tuple[int, int, Envelope | None]]) -> int:
    """Write a segment again with other envelopes in some frames, or none; how many changed.

    The other frames are copied byte by byte. A segment without changes stays.
    """
    engine = rawlog.compressor()
    frames = [
        (start, end, b"" if envelope is None else engine.compress(rawlog.encode(envelope)))
        for start, end, envelope in changes
    ]
    if not frames:
        return 0
    path = followed(path)  # what a link leads to would keep the rest
    with writing(path) as temporary, open_file(path) as old, temporary.open("wb") as new:
        at = 0
        for start, end, frame in frames:
            quarantine.copy(old, new, at, start)
            new.write(frame)
            at = end
        quarantine.copy(old, new, at, path.stat().st_size)
    return len(frames)


def over_segments(
    run: Run,
    paths: Sequence[Path],
    function: Callable[..., Any],
    tasks: Iterable[tuple[Any, ...]],
    *,
    in_order: bool = False,
) -> Iterator[Any]:
    """What a function says of each segment, in worker processes if there are many of them.

    `tasks` are its arguments, a tuple a segment, taken one after another with `in_order`. Raises
    Interrupted.
    """
    large = sum(path.stat().st_size for path in paths) > _PARALLEL
    workers = run.workers if large and not in_order else 1
    engine = run.engine if workers > 1 else "local"
    with make_executor(engine, workers, run.scheduler, run.root) as executor:
        yield from map_in_order(executor, function, tasks, window=executor.window)


def check_readable(root: Path, source: str, threads: int) -> None:
    """Read every segment. Raises DamagedData for the first that can't be read in full, except for
    the torn end of an open one; Interrupted.
    """

    def read(path: Path) -> None:
        signals.stop.check()
        for _ in rawlog.Frames(path, checked=True):
            pass

    with make_threads(threads) as pool:  # decompressing releases the interpreter lock
        list(pool.map(read, rawlog.all_segments(root, source)))


def uncommitted(frontier: Frontier, paths: Iterable[Path]) -> Iterator[Path]:
    """The segments. The state forgets each one before it is handed out to be written again.

    A shorter segment than the state knows would count as lost. If the purge is killed before
    its new size is noted, the segment is read again, which changes nothing.
    """
    for path in paths:
        frontier.set_offset(path.parent.name, rawlog.base_name(path), 0)
        yield path
