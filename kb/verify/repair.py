"""Repairs a data root step by step: restores copies and quarantines damaged files, then fetches
lost answers and rebuilds what is derived from them.

Foreign files are never touched, and nothing is deleted: what is damaged gets the ending
`.damaged`, or is noted for the next crawl. What each step does is given by pipelines/verify.py.
"""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

from kb.core.errors import GLOBAL_STOPS, KbError
from kb.core.progress import Progress
from kb.store import lock
from kb.store.artifact_registry import MANIFEST, SUMS
from kb.store.atomic import write_bytes
from kb.store.layout import CAPTURED, Layout, parquet_files
from kb.store.rawlog import sidefiles
from kb.store.state import tombstones
from kb.verify.findings import Findings, VerifyFinding
from kb.verify.root import verify

Act = Callable[[], object]


class Step(Protocol):
    """One thing that a repair may do."""

    def take(self, root: Path, findings: Findings) -> list[str]:
        """Do it where it has to be done: a line for each thing that was done, or left."""
        ...


def repaired(root: Path, progress: Progress, steps: Iterable[Step]) -> tuple[Findings, list[str]]:
    """Verify, repair and verify again, under all locks: (what is left, lines of what was done).

    Raises WriterLocked, DiskFull, Interrupted.
    """
    with lock.taking(root, *lock.ORDER):  # which clears what killed commands left
        findings = verify(root, progress)
        actions = _quarantine(root, findings)
        for step in steps:
            actions += step.take(root, findings)
        # Of what was killed on its way nothing may be found any more.
        return (verify(root, progress) if actions else findings), actions


@dataclass(frozen=True)
class Crawl:
    """What is lost of a source's raw data: damage is set aside, then a crawl asks again for it."""

    source: str
    set_aside: Callable[[], list[str]]
    crawl: Act

    def take(self, root: Path, findings: Findings) -> list[str]:
        """See `Step`. What is filtered afterwards is noted: the repair may be killed before."""
        at = Layout(root)
        note, places = at.repairing(self.source), (at.raw(self.source), at.state(self.source))
        is_lost = any(
            one.state != "foreign" and any(map(one.path.is_relative_to, places))
            for one in findings.of("raw answers", "captures", "images", "state")
        )
        if not is_lost and not note.exists():
            return []
        if at.clean(self.source).is_dir():
            write_bytes(note, b"")
        return [*self.set_aside(), *_tried(f"kb {self.source} crawl", self.crawl)]


@dataclass(frozen=True)
class Make:
    """What is at `places` is made of what is before it, also where a crawl of `after` went on."""

    kind: str
    command: str
    make: Act
    places: tuple[Path, ...]
    after: str = ""

    def take(self, root: Path, findings: Findings) -> list[str]:
        """See `Step`; not where a file of somebody else's would go with it."""
        note = Layout(root).repairing(self.after) if self.after else None
        fresh = note is not None and note.exists()
        here = [one for one in findings.entries if any(map(one.path.is_relative_to, self.places))]
        lost = any(one.kind == self.kind and one.state != "foreign" for one in here)
        if not fresh and not lost:
            return []
        for one in here:
            if one.state == "foreign" and one.kind != "leftovers":
                way = f"move {one.path} away, then run `{self.command}`"
                return [f"{self.places[0]} was left: {way}"]
        return _tried(self.command, self.make, note)


@dataclass(frozen=True)
class Describe:
    """A released folder that was described once and has tables and no checksums.

    It was made again, by this repair or by one that was killed before it came to the description.
    """

    source: str
    describe: Act

    def take(self, root: Path, findings: Findings) -> list[str]:
        """See `Step`."""
        folder, known = Layout(root).release(self.source), Layout(root).released(self.source)
        described = known.is_dir() and any(known.iterdir())
        if not described or not parquet_files(folder) or (folder / SUMS).exists():
            return []
        return _tried("kb release", self.describe)


def _tried(command: str, act: Act, note: Path | None = None) -> list[str]:
    """What a command does, or why it could not; `note` goes when it succeeded."""
    try:
        act()
        if note is not None:
            note.unlink(missing_ok=True)
    except GLOBAL_STOPS:
        raise
    except KbError as error:
        way = f"; {error.hint}" if error.hint else ""
        return [f"`{command}` failed: {error}{way}"]
    return [f"`{command}` was run"]


def _quarantine(root: Path, findings: Findings) -> list[str]:
    """Lines of what was done."""
    actions = [_tombstones(root, one) for one in findings.of("tombstones", state="damaged")]
    for one in findings.of("annotations"):
        if one.state == "foreign":
            continue
        if one.state == "damaged":
            sidefiles.quarantine_file(one.path)
        (one.path.parent / MANIFEST).unlink(missing_ok=True)  # which lists the lost file
        what = "was set aside" if one.state == "damaged" else "is missing"
        actions.append(f"{one.path} {what}; the next filter scores its texts again")
    for one in findings.of("state", state="damaged"):
        if one.path.suffix == ".sqlite":
            for ending in ("-wal", "-shm"):
                one.path.with_name(one.path.name + ending).unlink(missing_ok=True)
            sidefiles.quarantine_file(one.path)
            actions.append(f"{one.path} was set aside; it is built again from the raw data")
    lost = [one.path for one in findings.of("captures", "images") if one.state != "foreign"]
    if lost:
        sidefiles.suspect(root, CAPTURED, lost)
        actions.append(f"{len(lost):,} captured files are noted for `kb wiki crawl`")
    return actions


def _tombstones(root: Path, one: VerifyFinding) -> str:
    source = one.path.parent.name
    for other in Layout(root).tombstones(source):
        # A copy that is as whole takes its place; of two damaged ones none is right.
        if other != one.path and tombstones.is_readable(other):
            write_bytes(one.path, other.read_bytes())
            return f"{one.path} was restored from its copy {other}"
    return f"{one.path} could not be repaired: no intact copy exists; restore it from a backup"
