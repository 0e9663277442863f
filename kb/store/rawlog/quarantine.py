"""Damage in the raw log: it moves aside, the state is replayed from what is left, and what is
absent then is to do again.

    damaged bytes     set aside as `<segment>.ndjson.zst.damaged-<offset>`; the frames on both
                      sides stay
    missing, short    the state knows how far each segment was read, so it knows what is not there
    what was in it    what the earlier state had as answered and the replayed one has not

The command that finds damage ends with exit 1 and names it; the next crawl asks again, and until
it has, `check` keeps filters from taking what is lost for what never was.
"""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import BinaryIO, NamedTuple

from kb.core.errors import DamagedData
from kb.core.sources import SOURCES
from kb.store.atomic import followed, write_bytes, writing
from kb.store.damage import note_damage, noted_damage, open_file
from kb.store.layout import Layout
from kb.store.rawlog import rawlog
from kb.store.rawlog.rawlog import Envelope
from kb.store.state.frontier import Frontier
from kb.store.tables import reading

Apply = Callable[[Frontier, str, Envelope], None]
"""Takes (frontier, kind, envelope) into the frontier; must be idempotent."""
_IMPORTED = {kind: hint for source in SOURCES.values() for kind, hint in source.imported.items()}
_NAMED = 3  # items that a message names
_CHUNK = 1 << 16


class LostRange(NamedTuple):
    """A stretch of a raw segment that is gone, `start` and `end` in bytes of the segment as it was.

    `quarantined_as` is the name of the file beside it that gets the bytes, "" where there are none.
    """

    path: Path
    start: int
    end: int
    quarantined_as: str = ""

    def __str__(self) -> str:
        path = self.path.with_name(f"{rawlog.base_name(self.path)}{rawlog.SUFFIX}")
        return f"{path} {self.what}"

    @property
    def what(self) -> str:
        """How the segment differs from what it was."""
        lost, place = f"{self.end - self.start:,} bytes", f"at {self.start:,} can't be read"
        if self.quarantined_as:
            return f"is damaged: {lost} {place} and were set aside as {self.quarantined_as}"
        if self.path.is_file() and self.path.stat().st_size > self.start:
            return f"is damaged: {lost} {place}"
        what = f"ends at byte {self.start:,}, {lost} are missing"
        return what if self.start else "is missing"


def note(root: Path, source: str, error: DamagedData, hint: str) -> None:
    """Note the raw segments that an error is about, as far as they can't be read in full, for the
    next command that writes raw data. The error then says `hint`.

    Where all are whole (they hold what a parser doesn't take) no crawl would find anything to fix.
    """
    base = Layout(root).raw(source).resolve()
    damaged = [
        path
        for path in error.paths
        if path.parent.parent.resolve() == base and gaps(path, path.stat().st_size)
    ]
    if damaged:
        note_damage(root, damaged)
        error.hint = hint


def noted_segments(root: Path, source: str) -> list[Path]:
    """The segments that commands noted as damaged."""
    noted = noted_damage(root, Layout(root).raw(source))
    return [path for path in noted if path.name.endswith((rawlog.SUFFIX, rawlog.OPEN))]


def lost_imports(lost: Sequence[LostRange]) -> list[tuple[str, str]]:
    """(kind, segment) of those that no crawl can ask for."""
    places = [(path.parent.name, path.name) for path, *_ in lost]
    return [place for place in dict.fromkeys(places) if place[0] in _IMPORTED]


def losses(root: Path, source: str, frontier: Frontier, *, every: bool = False) -> list[LostRange]:
    """What can't be read, is missing or is shorter than the state knows. Changes nothing.

    Reads open segments, those that the state knows in part, noted ones, and with `every` all of
    them. `kb.store.rawlog.recorder` reads a closed segment that the state does not know.
    """
    lost: list[LostRange] = []
    noted, known = noted_segments(root, source), frontier.offsets()
    for path in rawlog.all_segments(root, source):
        committed = known.pop((path.parent.name, rawlog.base_name(path)), 0)
        sure = committed in (0, path.stat().st_size) and not path.name.endswith(".open")
        lost += lost_of(path, committed, read=every or not sure or path in noted)
    for (kind, name), committed in known.items():
        path = rawlog.folder(root, source, kind) / f"{name}{rawlog.SUFFIX}"
        lost += [LostRange(path, 0, committed)] if committed else []
    return lost


def lost_of(path: Path, committed: int = 0, *, read: bool = True) -> list[LostRange]:
    """What is lost of a segment of which the state knows so many bytes; with `read` also what of it
    can't be read.
    """
    size = path.stat().st_size
    damaged = gaps(path, min(committed, size)) if read else []
    lost = [LostRange(path, start, end) for start, end in damaged]
    return [*lost, LostRange(path, size, committed)] if committed > size else lost


def set_aside(lost: Sequence[LostRange]) -> list[LostRange]:
    """Move damaged bytes out of their segments; the same with the names of their files. Raises
    DiskFull.
    """
    named = [
        stretch._replace(quarantined_as=quarantine_name(*stretch[:3]))
        if stretch.path.is_file() and stretch.path.stat().st_size > stretch.start
        else stretch
        for stretch in lost
    ]
    damaged = [stretch for stretch in named if stretch.quarantined_as]
    for path in dict.fromkeys(stretch.path for stretch in damaged):
        move_out(path, [stretch[1:] for stretch in damaged if stretch.path == path])
    return named


def refuse_lost_answers(root: Path, source: str) -> None:
    """Raises DamagedData when raw answers are lost that were not asked for again. Reads only.

    Raises DiskFull where there is no room for SQLite to read.
    """
    path = Layout(root).state(source)
    if not path.is_file():
        return
    with reading.state(path) as frontier:
        items, lost = frontier.lost(), losses(root, source, frontier)
    if lost or items:
        error = damage_of(root, source, lost, [*items, *lost_imports(lost)])
        if not items:  # nobody has looked up yet what was in it
            error.hint = f"run `kb {source} crawl`, which sets damage aside and fetches it again"
        raise error


def damage_of(
    root: Path, source: str, lost: Sequence[LostRange], items: Sequence[tuple[str, str]]
) -> DamagedData:
    """The error of lost ranges, and of the (kind, key) of what was in them."""
    what = str(lost[0]) if lost else f"raw data were lost from {Layout(root).raw(source)}"
    if items:
        named = ", ".join(f"{kind} {key}" for kind, key in items[:_NAMED])
        more = f" and {len(items) - _NAMED:,} more" if len(items) > _NAMED else ""
        what += f"; lost are the answers of {named}{more}"
    if len(lost) > 1:
        what += f" (and {len(lost) - 1:,} more places)"
    hints = [_IMPORTED[kind] for kind, _ in items if kind in _IMPORTED]
    if len(hints) < len(items) or not lost:
        hints.append(f"run `kb {source} crawl`: it fetches them again")
    hint = "; ".join(dict.fromkeys(hints)) or "no known answer was lost: the same command resumes"
    return DamagedData(what, hint=hint)


def remove_quarantined(root: Path, source: str) -> None:
    """Remove what was set aside: nobody can read it, and any of it may hold a purged key."""
    for path in quarantined_files(root, source):
        path.unlink()


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
