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

from kb.core.context import Run
from kb.core.engine import make_executor, map_in_order
from kb.schema import answer_keys as schema
from kb.store.atomic import followed, writing
from kb.store.damage import open_file
from kb.store.rawlog import quarantine, rawlog
from kb.store.rawlog.rawlog import Envelope, Request, intact_frames

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


def changed_frames(
    path: Path, matches: Matcher, strip: Callable[[Envelope], Envelope | None]
) -> Iterator[tuple[int, bytes, Envelope]]:
    """The frames of a segment that change: where each starts, its line and its envelope.

    Raises DamagedData after the last readable frame if some could not be read.
    """
    frames = rawlog.Frames(path, checked=True)
    for _, line in frames:
        if matches(line):
            envelope = rawlog.decode(line)
            if strip(envelope) is not envelope:
                yield frames.start, line, envelope


def rewrite_segment(
    path: Path, starts: Iterable[int], strip: Callable[[Envelope], Envelope | None]
) -> None:
    """Write a segment again with what is left of the frames that start there.

    The other frames are copied byte by byte.
    """
    engine, at = rawlog.compressor(), 0
    path = followed(path)  # what a link leads to would keep the rest
    with writing(path) as temporary, open_file(path) as old, temporary.open("wb") as new:
        for place in starts:
            start, end, line = next(intact_frames(old, place))
            quarantine.copy(old, new, at, start)
            if (left := strip(rawlog.decode(line))) is not None:
                new.write(engine.compress(rawlog.encode(left)))
            at = end
        quarantine.copy(old, new, at, path.stat().st_size)


def over_segments(
    run: Run,
    paths: Sequence[Path],
    function: Callable[..., Any],
    tasks: Iterable[tuple[Any, ...]],
) -> Iterator[Any]:
    """What a function says of each segment, in worker processes if there are many of them.

    `tasks` are its arguments, a tuple a segment. Raises Interrupted.
    """
    large = sum(path.stat().st_size for path in paths) > _PARALLEL
    workers = run.workers if large else 1
    engine = run.engine if workers > 1 else "local"
    with make_executor(engine, workers, run.scheduler, run.root) as executor:
        yield from map_in_order(executor, function, tasks, window=executor.window)
