"""Remove keys for good from every file of a data root, or count what that would remove.

A purge is a list of steps. Each step yields lines of what it removes; in a dry run, which is the
plan, it only counts. What differs between sources is in their `PurgeRules`.

    begin       the list of keys in state/, and tombstones, so that nothing comes back meanwhile
    raw         answers, and what else a source stores of a key
    state       items of the frontier
    index       removed; the next search builds it again
    rows        clean tables, verdicts, pairs, links, restored rows
    rest        scores, exports, releases and the report (pipelines/purge.py)

Every step may be repeated. The list of keys stays until the last step is done, so a purge that was
interrupted continues where it stopped.
"""

from __future__ import annotations

import shutil
import tempfile
from collections import Counter
from collections.abc import Callable, Collection, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path

import msgspec

from kb.artifacts import index as index_of
from kb.artifacts import manifest, purge_raw
from kb.artifacts.purge_named import ABSENT, KNOWN, NAMED, UNKNOWN, PurgeList, in_answers, warn
from kb.artifacts.purge_people import PeopleList, PeopleRules, people, say_absent, unseen
from kb.artifacts.purge_raw import Matcher, Names, Strip
from kb.artifacts.purge_rows import RowLocation, drop_rows, keys_in_rows, released
from kb.core.context import Run
from kb.core.errors import DamagedData
from kb.core.sources import SOURCES
from kb.core.summary import Summary
from kb.store import lock
from kb.store.artifact_registry import artifact_of
from kb.store.atomic import write_bytes
from kb.store.layout import BELOW, Layout
from kb.store.rawlog import damaged_answers, rawlog
from kb.store.rawlog.rawlog import Envelope
from kb.store.state import json_files, tombstones
from kb.store.state.frontier import Frontier
from kb.store.state.tombstones import PERSON
from kb.store.tables import partition
from kb.store.walk import files_below


class PurgeLine(msgspec.Struct):
    """What one folder below the data root loses."""

    folder: str
    what: str
    count: int


def by_presence(purge: Purge) -> dict[str, str]:
    """Each key that the user named, with NAMED, KNOWN or UNKNOWN.

    A key is in the data root when the state, a table or a raw answer has it; the raw answers are
    read for those that are neither in the state nor in a table.
    """
    keys, rules = purge.listed.keys if purge.listed else [], purge.rules
    before = tombstones.keys(purge.root, rules.source)
    sought = {key for key in keys if key not in before}
    sought -= {key for kind in rules.items for key in sought if purge.frontier.get(kind, key)}
    sought -= keys_in_rows(purge.root, (*rules.rows, *released(rules.rows)), sought)
    if sought:
        about = (rules.source, sought, rules.texts, rules.strip_envelope, purge.scratch)
        sought -= in_answers(purge.run, *about)
    return {key: KNOWN if key in before else UNKNOWN if key in sought else NAMED for key in keys}


@dataclass(frozen=True)
class PurgeRules:
    """What a purge has to know about a source; a source leaves out the parts that it does not have.

    read_ids    reads a list of ids; raises SettingError where no entry names an item
    look_up     each key that the list names, with NAMED, KNOWN or UNKNOWN (purge_named)
    rows        where rows name keys
    items       kinds of the frontier whose items have the key of what is removed
    exact       raw kinds with one answer per key, of which unreadable bytes of other keys may stay
    find        what else is to be removed, and why; for a key that the user named, its reason wins
    texts       texts of which one is in every answer with a key; None: any answer may have one
    names       other names that leave the answers with the keys; also removes files and state that
                can only be found while the answers are complete
    strip       removes keys from an answer; by default as the schemas of the raw kinds say
    repeats     ids of rows that repeat some of what the answer shows of a key
    forget      removes from the frontier what `items` does not cover
    repair      corrects rows that count or repeat rows which were removed
    in_order    segments are written one after another, as `names` reads the last ones again
    implied     the reason of keys that are only removed because another one is
    people      how people are named and found whose content leaves as a whole
    """

    source: str
    read_ids: Callable[[Path, Callable[[str], None] | None], PurgeList]
    rows: tuple[RowLocation, ...]
    items: tuple[str, ...] = ()
    exact: tuple[str, ...] = ()
    look_up: Callable[[Purge], dict[str, str]] = by_presence
    find: Callable[[Purge], dict[str, str]] | None = None
    texts: Callable[[Collection[str]], Iterable[str] | None] = frozenset
    names: Callable[[Purge], Names] | None = None
    strip: Strip | None = None
    repeats: Callable[[Envelope, Collection[str]], Iterable[str]] | None = None
    forget: Callable[[Purge], None] | None = None
    repair: Callable[[Purge], None] | None = None
    in_order: bool = False
    implied: str = ""
    people: PeopleRules | None = None

    def strip_envelope(self, kind: str, envelope: Envelope, names: Names) -> Envelope | None:
        """The envelope without the names, as `Strip` describes."""
        if self.strip is not None:
            return self.strip(kind, envelope, names)
        return purge_raw.strip_by_schema(self.source, kind, envelope, names)


@dataclass
class Purge:
    """A purge under way, or with `dry` its plan.

    `asked` are people to be left out, `keys` what is removed and why, `absent` named ones that the
    data root does not have (KNOWN or UNKNOWN), `names` other names of what is removed, of which
    `other_names` are those people's, `counts` what else the summary says. `scratch` is a folder for
    work files; `keys_file` has the keys for worker processes.
    """

    run: Run
    rules: PurgeRules
    listed: PurgeList | None
    frontier: Frontier
    scratch: Path
    dry: bool = False
    asked: PeopleList | None = None
    keys: dict[str, str] = field(default_factory=dict)
    absent: dict[str, str] = field(default_factory=dict)
    names: Names = field(default_factory=dict)
    other_names: Names = field(default_factory=dict)
    repeats: set[str] = field(default_factory=set)
    counts: dict[str, int] = field(default_factory=dict)

    @property
    def root(self) -> Path:
        """The data root."""
        return self.run.root

    @property
    def keys_file(self) -> Path:
        """The list of keys in state/; in a dry run a copy elsewhere."""
        return (
            self.scratch / "keys.json" if self.dry else Layout(self.root).purge(self.rules.source)
        )

    def find(self) -> None:
        """Find what is to be removed, with what an interrupted purge left."""
        # What an interrupted purge found out can't be found out again.
        self.keys = left = unfinished(self.root, self.rules.source)
        try:
            named = self.rules.look_up(self)
            if self.rules.people is not None:
                named |= people(self, self.rules.people, self.asked)
        except DamagedData:
            # A damaged table may hold any of it. What was asked for is recorded all the same: the
            # step that rewrites the table reports the damage, and until then no release is made.
            named = dict.fromkeys(self.listed.keys if self.listed else (), NAMED)
            if self.rules.people is not None and self.asked is not None:
                named |= unseen(self, self.rules.people, self.asked)
        named |= left
        self.keys = {key: NAMED if why in ABSENT else why for key, why in named.items()}
        more = self.rules.find(self) if self.rules.find else {}
        self.absent = {k: why for k, why in named.items() if why in ABSENT and k not in more}
        self.keys = more | self.keys
        say, absent = self.run.progress.say, self.absent
        if self.listed is not None:
            self.counts["bad_lines"] = self.listed.bad_lines
            warn(self.listed, {k: absent[k] for k in absent if not k.startswith(PERSON)}, say)
        if self.rules.people is not None and self.asked is not None:
            theirs = {k: absent[k] for k in absent if k.startswith(PERSON)}
            say_absent(self.rules.people, self.asked, theirs, say)

    def begin(self) -> None:
        """Write the list of keys, then their tombstones."""
        if self.dry or self.keys:
            self.keys_file.parent.mkdir(parents=True, exist_ok=True)
            write_bytes(
                self.keys_file, msgspec.json.encode(self.keys | self.absent, order="sorted")
            )
        if self.keys and not self.dry:
            tombstones.add(self.root, self.rules.source, self.keys.items())
        if self.keys:
            names = self.rules.names(self) if self.rules.names else {}
            self.names = {**names, **self.other_names}

    def summary(self) -> dict[str, int]:
        """What became of each key that is removed for its own sake, and of the user's lists. People
        are known or unknown; what was purged are items.
        """
        implied, became = self.rules.implied, Counter(self.absent.values())
        own = {
            key
            for key, reason in self.keys.items()
            if reason != implied and not key.startswith(PERSON)
        }
        unread = self.listed.bad_lines if self.listed else 0
        return {
            "purged": len(own - self.absent.keys()),
            "known": became[KNOWN],
            "unknown": became[UNKNOWN],
            "unread": unread + (len(self.asked.unread) if self.asked else 0),
        }


def unfinished(root: Path, source: str) -> dict[str, str]:
    """The list of an interrupted purge (key → reason), {} if there is none."""
    hint = f"delete it, then run `kb purge {source}` again"
    return json_files.read(Layout(root).purge(source), dict[str, str], fix=hint) or {}


def finish(root: Path, source: str) -> None:
    """After the last step: compact the state and forget the list of keys.

    Raises WriterLocked, DiskFull, and DamagedData if some raw data could not be read: everything
    that could be read was purged.
    """
    with lock.writer(root, source):
        frontier = Frontier(Layout(root).state(source))
        try:
            frontier.forget()
            Layout(root).purge(source).unlink(missing_ok=True)
            # Parts of interrupted links have keys of all sources, whether there are links or not.
            shutil.rmtree(Layout(root).linking, ignore_errors=True)
            damaged_answers.report(root, source, frontier)
        finally:
            frontier.close()


@contextmanager
def dry_purge(
    run: Run, rules: PurgeRules, listed: PurgeList | None, asked: PeopleList | None = None
) -> Iterator[Purge]:
    """A dry purge on a copy of the source's state. Nothing below the data root is written."""
    original = Layout(run.root).state(rules.source)
    with tempfile.TemporaryDirectory(prefix="lorecrawl-plan-") as scratch:
        for file in (original, original.with_name(f"{original.name}-wal")):
            if file.is_file():
                shutil.copyfile(file, Path(scratch, file.name))
        payloads = SOURCES[rules.source].connector(run).payloads
        frontier = Frontier(Path(scratch, original.name), payloads=payloads)
        try:
            purge = Purge(run, rules, listed, frontier, Path(scratch, "work"), True, asked)
            purge.find()
            purge.begin()
            yield purge
        finally:
            frontier.close()


# -- steps -----------------------------------------------------------------------------------------

Step = Callable[[Purge], Iterator[PurgeLine]]


def answers(purge: Purge) -> Iterator[PurgeLine]:
    """Raw answers, segment by segment, in worker processes if there are many.

    Raises Interrupted, DiskFull, DamagedData.
    """
    source, run, changed = purge.rules.source, purge.run, Counter[str]()
    paths = rawlog.all_segments(purge.root, source)
    work = (purge.rules, str(purge.keys_file), purge.names, purge.dry)
    todo = paths if purge.dry else purge_raw.uncommitted(purge.frontier, paths)
    tasks = ((str(path), *work) for path in todo)
    done = purge_raw.over_segments(run, paths, strip_segment, tasks, in_order=purge.rules.in_order)
    for path, (count, repeats) in zip(paths, done, strict=True):
        changed[path.parent.name] += count
        purge.repeats.update(repeats)
        if not purge.dry:  # the state knows all of a segment that was written again
            place = path.parent.name, rawlog.base_name(path)
            purge.frontier.set_offset(*place, path.stat().st_size)
    for kind in rawlog.kinds(purge.root, source):
        yield PurgeLine(str(BELOW.raw(source, kind)), "answers", changed[kind])


def strip_segment(
    segment: str, rules: PurgeRules, keys_file: str, names: Names, dry: bool
) -> tuple[int, list[str]]:
    """How many answers of a segment change, and the ids that `repeats` yields. Runs in a worker."""
    others = frozenset[str]().union(*names.values())
    path, keys, matches = Path(segment), *_keys(keys_file, rules, others, _version(keys_file))
    repeats: set[str] = set()

    def strip(envelope: Envelope) -> Envelope | None:
        if rules.repeats:
            repeats.update(rules.repeats(envelope, keys))
        return rules.strip_envelope(path.parent.name, envelope, {**names, "": keys})

    with partition.without_collecting():
        changes = purge_raw.changed_frames(path, matches, strip)
        count = sum(1 for _ in changes) if dry else purge_raw.rewrite_segment(path, changes)
    return count, sorted(repeats)


def _version(keys_file: str) -> tuple[int, int] | None:
    try:
        about = Path(keys_file).stat()
    except FileNotFoundError:  # nothing to remove
        return None
    return about.st_mtime_ns, about.st_ino


@lru_cache(maxsize=1)
def _keys(
    file: str, rules: PurgeRules, others: frozenset[str], version: tuple[int, int] | None
) -> tuple[frozenset[str], Matcher]:
    if version is None:
        return frozenset(), purge_raw.Matcher(())
    keys = frozenset(msgspec.json.decode(Path(file).read_bytes(), type=dict[str, str]))
    texts = rules.texts(keys) if keys else ()
    return keys, purge_raw.Matcher(texts if texts is None else {*texts, *others})


def state(purge: Purge) -> Iterator[PurgeLine]:
    """Items of the frontier, and unreadable bytes that may hold a key."""
    if not purge.dry:
        rules, frontier = purge.rules, purge.frontier
        damaged_answers.remove_quarantined(
            purge.root, rules.source, frontier, purge.keys, rules.exact
        )
        for kind in rules.items:
            frontier.remove(kind, purge.keys)
        if rules.forget:
            rules.forget(purge)
    return iter(())


def rows(purge: Purge) -> Iterator[PurgeLine]:
    """Rows of tables; a dry run also counts those of releases, which are written again later."""
    for location in purge.rules.rows if not purge.dry else ():
        for work in (purge.root / location.folder).parent.glob(".work*"):
            shutil.rmtree(work, ignore_errors=True)  # of an interrupted restore, which asks again
    if purge.dry:
        locations = *purge.rules.rows, *released(purge.rules.rows)
        yield from _rows(purge, locations)
        return
    folders = (purge.root / location.folder / "rows" for location in purge.rules.rows)
    artifacts = {match[1].name for folder in folders if (match := artifact_of(folder))}
    with manifest.editing(purge.root, *sorted(artifacts)):
        yield from _rows(purge, purge.rules.rows)
        if purge.rules.repair:
            purge.rules.repair(purge)


def _rows(purge: Purge, locations: Iterable[RowLocation]) -> Iterator[PurgeLine]:
    lines = drop_rows(purge.root, locations, purge.keys, dry=purge.dry)
    return (PurgeLine(*line) for line in lines)


def index(purge: Purge) -> Iterator[PurgeLine]:
    """The index of `kb search`."""
    folder = Layout(purge.root).index(purge.rules.source)
    yield from count_files(purge.root, folder, "files, built again by the next search")
    if not purge.dry:
        index_of.remove(purge.root, purge.rules.source)


def exports(purge: Purge) -> Iterator[PurgeLine]:
    """What a dry run says of the folders that are written again as a whole."""
    at = Layout(purge.root)
    for folder in (at.export(), at.report) if purge.dry else ():
        yield from count_files(
            purge.root, folder, "files, written again if they come from this source"
        )


def count_files(root: Path, folder: Path, what: str) -> Iterator[PurgeLine]:
    """A line for a folder that has files."""
    count = sum(1 for _ in files_below(folder, root, strict=False))
    yield PurgeLine(str(folder.relative_to(root)), what, count)


def plan_summary(purge: Purge, lines: Iterable[PurgeLine]) -> Summary:
    """The counts of a dry run, in all and by folder."""
    lines = [line for line in lines if line.count]

    def total(folder: str) -> int:
        return sum(line.count for line in lines if line.folder.split("/")[0] == folder)

    return Summary(
        command=f"purge {purge.rules.source} --plan",
        source=purge.rules.source,
        **purge.summary(),
        answers=total("raw"),
        rows=total("clean"),
        pairs=total("pairs"),
        links=total("links"),
        released=total("release"),
        lines=[msgspec.to_builtins(line) for line in lines],
        **purge.counts,
    )
