"""Damaged and missing answers of the raw log: quarantines them and queues them for the next crawl.

    damaged bytes     set aside as `<segment>.ndjson.zst.damaged-<offset>`; the frames on both
                      sides stay
    missing, short    the state knows how far each segment was read, so it knows what is not there
    what was in it    the state says what was answered; the raw data that are left say what still is

Everything is noted in the state before a file changes, so that a run that is killed is finished
by the next one. The command that finds damage ends with exit 1 and names it; the next crawl asks
again, and until it has, `check` keeps filters from taking what is lost for what never was.
"""

import shutil
from collections.abc import Callable, Collection, Sequence
from pathlib import Path
from typing import BinaryIO

import msgspec

from kb.core.errors import DamagedData
from kb.store.atomic import followed, write_bytes, writing
from kb.store.damage import open_file
from kb.store.layout import Layout
from kb.store.rawlog import rawlog
from kb.store.rawlog.rawlog import Envelope
from kb.store.state.frontier import Frontier
from kb.store.tables import reading

Apply = Callable[[Frontier, str, Envelope], None]
"""Takes (frontier, kind, envelope) into the frontier; must be idempotent."""
DUMPS = "dumps"  # the one raw kind that no crawl can ask for: its files have to be imported again
_LOST, _SUSPECTS = "lost", "suspects"  # cursors of the frontier
_PAIRS = list[tuple[str, str]]
_NAMED = 3  # items that a message names
_CHUNK = 1 << 16


class LostRange(msgspec.Struct):
    """A stretch of a raw segment that is gone, `start` and `end` in bytes of the segment as it was.

    `quarantined_as` is the name of the file beside it that has the bytes, "" where there are none.
    `items` are the (kind, key) of what the state says was answered and no raw answer shows any
    more, None until that was looked up. `reported`: an error has named it.
    """

    kind: str
    segment: str
    start: int
    end: int
    quarantined_as: str = ""
    items: list[tuple[str, str]] | None = None
    reported: bool = False


def note(root: Path, source: str, frontier: Frontier, error: DamagedData, hint: str) -> None:
    """Note the raw segments that an error is about, as far as they can't be read in full, for the
    next command that writes raw data to look into.

    The error then says `hint`. Where all are whole (they hold what a parser doesn't take) no crawl
    would find anything to fix.
    """
    base = rawlog.folder(root, source, "").resolve()
    damaged = [
        (path.parent.name, rawlog.base_name(path))
        for path in error.paths
        if path.parent.parent.resolve() == base and gaps(path, path.stat().st_size)
    ]
    if damaged:
        known = {(kind, segment) for kind, segment in frontier.cursor(_SUSPECTS, [], of=_PAIRS)}
        frontier.set_cursor(_SUSPECTS, sorted(known | set(damaged)))
        error.hint = hint


def quarantine_damage(root: Path, source: str, frontier: Frontier, *, every: bool = False) -> None:
    """Set aside what can't be read, and note what is missing or short.

    Reads open segments, those that the state knows in part, suspects, and with `every` all of
    them. `kb.store.rawlog.recorder` reads a closed segment that the state does not know in full
    and reports its damage. Call it under the writer's lock, before open segments are closed.
    Raises DiskFull.
    """
    suspects = {(kind, segment) for kind, segment in frontier.cursor(_SUSPECTS, [], of=_PAIRS)}
    suspects |= {(lost.kind, lost.segment) for lost in _load(frontier) if lost.items is None}
    known = frontier.offsets()
    for path in rawlog.all_segments(root, source):
        kind, name, size = path.parent.name, rawlog.base_name(path), path.stat().st_size
        committed = known.pop((kind, name), 0)
        sure = committed in (0, size) and not path.name.endswith(".open")
        if committed > size:
            with frontier.transaction():
                _note(frontier, [LostRange(kind, name, size, committed)])
                frontier.set_offset(kind, name, size)
            committed = size
        if every or not sure or (kind, name) in suspects:
            quarantine_segment(path, frontier, committed)
    for (kind, name), committed in known.items():
        with frontier.transaction():
            _note(frontier, [LostRange(kind, name, 0, committed)] if committed else [])
            frontier.set_offset(kind, name, None)
    frontier.set_cursor(_SUSPECTS, None)


def quarantine_segment(path: Path, frontier: Frontier, committed: int = 0) -> None:
    """Set aside what can't be read of a segment of which the state knows so many bytes.

    Raises DiskFull.
    """
    kind, name = path.parent.name, rawlog.base_name(path)
    if not (stretches := gaps(path, committed)):
        return
    named = [(start, end, quarantine_name(path, start, end)) for start, end in stretches]
    with frontier.transaction():
        _note(frontier, [LostRange(kind, name, *stretch) for stretch in named])
        # Killed before the last line, the whole segment is read again, which changes nothing.
        frontier.set_offset(kind, name, 0)
    move_out(path, named)
    lost_bytes = sum(max(0, min(end, committed) - start) for start, end in stretches)
    frontier.set_offset(kind, name, max(0, committed - lost_bytes))


def requeue_lost_items(
    root: Path, source: str, frontier: Frontier, apply: Apply, asked: Collection[str]
) -> None:
    """Find out what was in the stretches that are lost, and make it to do again.

    The state is built once more out of the raw data that are left; what it had as answered and
    that one has not is lost. `asked` are the kinds of items that a crawl asks for.
    """
    losses = _load(frontier)
    if all(lost.items is not None for lost in losses):
        return
    scratch = Layout(root).rebuilt(source)
    shutil.rmtree(scratch, ignore_errors=True)
    rebuilt = Frontier(scratch / "state.sqlite", payloads=frontier.payloads)
    try:
        with rebuilt.transaction():
            for path in rawlog.all_segments(root, source):
                for _, line in rawlog.Frames(path, skip_damage=True):
                    apply(rebuilt, path.parent.name, rawlog.decode(line))
        items = [
            (kind, key)
            for kind in asked
            for key, *_ in frontier.items(kind, "done", "skipped")
            if (rebuilt.get(kind, key) or ("",))[0] not in ("done", "skipped")
        ]
        with frontier.transaction():
            for kind, key in items:
                kept = rebuilt.get(kind, key)
                if kept is not None and kept[1] is not None:
                    frontier.payload(kind, key, kept[1])
                frontier.mark(kind, [key], "todo")
            for lost in losses:
                if lost.items is None:
                    lost.items = items
            _save(frontier, losses)
    finally:
        rebuilt.close()
        shutil.rmtree(scratch, ignore_errors=True)


def report(root: Path, source: str, frontier: Frontier) -> None:
    """Raises DamagedData naming what no error has named yet. Call it under the writer's lock."""
    losses = _load(frontier)
    new = [lost for lost in losses if not lost.reported]
    if not new:
        return
    error = _error(root, source, new)
    for lost in losses:
        lost.reported = True
    _save(frontier, [lost for lost in losses if lost.items or lost.kind == DUMPS])
    raise error


def forget_refetched(frontier: Frontier, *, imported: bool = False) -> None:
    """Forget what was asked for again since it was lost; `imported`: every dump was read again."""
    losses = _load(frontier)
    left = [
        lost
        for lost in losses
        if not lost.reported or (_open(frontier, lost) and not (imported and lost.kind == DUMPS))
    ]
    if len(left) < len(losses):
        _save(frontier, left)


def check(root: Path, source: str) -> None:
    """Raises DamagedData when raw answers are lost that were not asked for again. Reads only.

    Raises DiskFull where there is no room for SQLite to read. Lost is what a crawl or purge took
    out, and segments that are shorter than the state knows.
    """
    path = Layout(root).state(source)
    if not path.is_file():
        return
    with reading.state(path) as frontier:
        losses = [lost for lost in _load(frontier) if _open(frontier, lost)]
        known = frontier.offsets()
    for segment in rawlog.all_segments(root, source):
        place, size = (segment.parent.name, rawlog.base_name(segment)), segment.stat().st_size
        committed = known.pop(place, 0)
        if committed > size:
            losses.append(LostRange(*place, size, committed))
        elif segment.name.endswith(".open"):
            # Readers take its end for a torn one; the state knows better.
            losses += [LostRange(*place, *gap) for gap in gaps(segment, committed)]
    losses += [LostRange(*place, 0, committed) for place, committed in known.items() if committed]
    if losses:
        raise _error(root, source, losses)


def remove_quarantined(root: Path, source: str) -> None:
    """Remove what was set aside: nobody can read it, and any of it may hold a purged key."""
    for path in quarantined_files(root, source):
        path.unlink()


def _open(frontier: Frontier, lost: LostRange) -> bool:
    """Whether something of it was not asked for again."""
    if lost.items is None or not lost.reported or lost.kind == DUMPS:
        return True
    return any(
        (frontier.get(kind, key) or ("",))[0] in ("todo", "in_progress") for kind, key in lost.items
    )


def _error(root: Path, source: str, losses: list[LostRange]) -> DamagedData:
    first = losses[0]
    where = rawlog.folder(root, source, first.kind) / f"{first.segment}{rawlog.SUFFIX}"
    still = where.with_name(f"{where.name}.open")
    if first.quarantined_as or (still.is_file() and still.stat().st_size > first.start):
        what = f"is damaged: {first.end - first.start:,} bytes at {first.start:,} can't be read"
        if first.quarantined_as and where.with_name(first.quarantined_as).exists():
            what += f" and were set aside as {first.quarantined_as}"
    elif first.start:
        what = f"ends at byte {first.start:,}, {first.end - first.start:,} bytes are missing"
    else:
        what = "is missing"
    items = first.items or []
    if items:
        named = ", ".join(f"{kind} {key}" for kind, key in items[:_NAMED])
        more = f" and {len(items) - _NAMED:,} more" if len(items) > _NAMED else ""
        what += f"; lost are the answers of {named}{more}"
    if len(losses) > 1:
        what += f" (and {len(losses) - 1:,} more places)"
    return DamagedData(f"{where} {what}", hint=_hint(source, losses))


def _hint(source: str, losses: list[LostRange]) -> str:
    if any(lost.kind == DUMPS for lost in losses):
        return "run `kb reddit import --again` with the dumps that were imported"
    if all(lost.items == [] for lost in losses):
        return "no known answer was lost: the same command resumes"
    return f"run `kb {source} crawl`: it fetches them again"


def _note(frontier: Frontier, new: list[LostRange]) -> None:
    losses = _load(frontier)
    known = {
        (lost.kind, lost.segment, lost.start, lost.end) for lost in losses if not lost.reported
    }
    fresh = [lost for lost in new if (lost.kind, lost.segment, lost.start, lost.end) not in known]
    if fresh:
        _save(frontier, losses + fresh)


def _load(frontier: Frontier) -> list[LostRange]:
    return frontier.cursor(_LOST, [], of=list[LostRange])


def _save(frontier: Frontier, losses: list[LostRange]) -> None:
    frontier.set_cursor(_LOST, msgspec.to_builtins(losses) or None)


def gaps(path: Path, committed: int) -> list[tuple[int, int]]:
    """The stretches (start, end) of a segment that hold no readable answer.

    A torn tail of an open segment counts where it begins before `committed`, the offset that the
    state knows; behind it nothing was promised.
    """
    frames = rawlog.Frames(path, skip_damage=True, checked=True)
    for _ in frames:
        pass
    stretches = list(frames.damaged)
    if frames.torn and (not path.name.endswith(".open") or frames.good < committed):
        stretches.append((frames.good, path.stat().st_size))
    return stretches


def quarantine_name(path: Path, start: int, end: int) -> str:
    """The name of the file that gets the damaged bytes of a segment; no reader of raw takes it.

    A file that has these bytes already, of a run that was killed, keeps them.
    """
    first = name = f"{rawlog.base_name(path)}{rawlog.SUFFIX}.damaged-{start}"
    number = 1
    with open_file(path) as file:
        file.seek(start)
        data = file.read(end - start)
    while (existing := path.with_name(name)).exists() and existing.read_bytes() != data:
        number += 1
        name = f"{first}-{number}"
    return name


def move_out(path: Path, stretches: Sequence[tuple[int, int, str]]) -> None:
    """Take stretches (start, end, name of the new file) out of a segment, which is written anew.

    Raises DiskFull.
    """
    with open_file(path) as file:
        for start, end, name in stretches:
            file.seek(start)
            write_bytes(path.with_name(name), file.read(end - start))
        with writing(followed(path)) as temporary, temporary.open("wb") as fresh:
            at = 0
            for start, end, _ in stretches:
                copy(file, fresh, at, start)
                at = end
            copy(file, fresh, at, path.stat().st_size)


def copy(file: BinaryIO, fresh: BinaryIO, start: int, end: int) -> None:
    """Bytes `start` to `end` of one file at the end of another."""
    file.seek(start)
    left = end - start
    while chunk := file.read(min(_CHUNK, left)):
        fresh.write(chunk)
        left -= len(chunk)


def quarantined_files(root: Path, source: str) -> list[Path]:
    """What was set aside of a source's segments."""
    return sorted(Layout(root).raw(source).glob(f"*/*{rawlog.SUFFIX}.damaged-*"))
