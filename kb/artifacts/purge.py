"""Removes keys for good from a data root, or counts what that would remove.

    find        what the user named, and what its service no longer shows
    begin       the note of the purge in state/, and tombstones, so that nothing comes back
    scan        the raw answers that have a key, in one pass that changes nothing
    derived     everything that is made of the source goes at once, as a whole
    answers     the raw answers without the keys
    kept        rows of what can't be made again: restored rows, labels
    state       items of the frontier
    finish      the state is compacted and the note is removed

Then the graph makes the derived artifacts again (pipelines/purge.py): their manifests say how they
were made and that nothing of them is left. Each step may be repeated, and the note stays until the
last one is done, so the same command resumes an interrupted purge. What differs between sources is
in their `PurgeRules`.
"""

from __future__ import annotations

import shutil
from collections import Counter, defaultdict
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from functools import lru_cache, partial
from pathlib import Path
from typing import NamedTuple

import msgspec

from kb.artifacts import freshness, index, manifest, purge_raw
from kb.artifacts.freshness import sources_of
from kb.artifacts.manifest import Manifest
from kb.artifacts.purge_named import ABSENT, KNOWN, NAMED, UNKNOWN, PurgeList, warn
from kb.artifacts.purge_people import PeopleList, PeopleRules, people, say_absent
from kb.artifacts.purge_raw import AnswerRules, Matcher, Names
from kb.artifacts.purge_rows import RowLocation, drop_rows, keys_in_rows, released
from kb.artifacts.purge_selections import drop_described, locations_in, selected_from
from kb.core import signals
from kb.core.context import Run
from kb.core.errors import DamagedData
from kb.store import lock
from kb.store.artifact_registry import ARTIFACTS, RELEASE, artifact_of
from kb.store.atomic import remove_path, write_bytes
from kb.store.damage import read_note
from kb.store.layout import BELOW, Layout
from kb.store.rawlog import quarantine, rawlog
from kb.store.rawlog.rawlog import Envelope
from kb.store.state import tombstones
from kb.store.state.frontier import Frontier
from kb.store.state.tombstones import PERSON
from kb.store.tables import partition
from kb.store.walk import files_below


class PurgeLine(msgspec.Struct):
    """What one folder below the data root loses."""

    folder: str
    what: str
    count: int


class PurgeNote(msgspec.Struct, forbid_unknown_fields=True):
    """What an unfinished purge must not forget: the keys with their reasons, the manifests of what
    was derived, and the text of files that are kept of it, by their path in the data root.
    """

    keys: dict[str, str]
    manifests: dict[str, Manifest] = {}
    files: dict[str, str] = {}


def by_presence(purge: Purge) -> dict[str, str]:
    """Each key that the user named, with NAMED, KNOWN or UNKNOWN.

    A key is in the data root when the state, a table or a raw answer has it; `scan` looks for
    UNKNOWN ones in the answers. A damaged table may hold any key.
    """
    keys, rules = purge.listed.keys if purge.listed else [], purge.rules
    before = tombstones.keys(purge.root, rules.source)
    sought = {key for key in keys if key not in before}
    sought -= {key for kind in rules.items for key in sought if purge.frontier.get(kind, key)}
    try:
        sought -= keys_in_rows(purge.root, (*rules.rows, *released(rules.rows)), sought)
    except DamagedData:
        sought = set()
    return {key: KNOWN if key in before else UNKNOWN if key in sought else NAMED for key in keys}


def with_named(named: Mapping[str, str], others: Mapping[str, str]) -> dict[str, str]:
    """Keys with their reasons. What the user named counts as named, and is never absent when it is
    among the others as well.
    """
    return {**others, **{key: NAMED if key in others else why for key, why in named.items()}}


@dataclass(frozen=True)
class PurgeRules:
    """What a purge has to know about a source.

    read_ids    reads a list of ids; raises SettingError where no entry names an item
    rows        where rows name keys, derived ones included
    items       kinds of the frontier whose items have the key of what is removed
    answers     how keys leave raw answers
    find        the keys to remove with the reason of each: those that the user named with NAMED,
                KNOWN or UNKNOWN, and what else is gone or belongs to them
    forget      removes from the state, and corrects in kept rows, what follows from removed keys
    people      how people are named and found whose content leaves as a whole
    """

    source: str
    read_ids: Callable[[Path, Callable[[str], None] | None], PurgeList]
    rows: tuple[RowLocation, ...]
    items: tuple[str, ...] = ()
    answers: AnswerRules = field(default_factory=AnswerRules)
    find: Callable[[Purge], dict[str, str]] = by_presence
    forget: Callable[[Purge], None] | None = None
    people: PeopleRules | None = None

    def strip(self, kind: str, envelope: Envelope, names: Names) -> Envelope | None:
        """The envelope without the names, as `purge_raw.Strip` describes."""
        if self.answers.strip is not None:
            return self.answers.strip(kind, envelope, names)
        return purge_raw.strip_by_schema(self.source, kind, envelope, names)


@dataclass
class Purge:
    """A purge under way, or with `dry` its plan.

    `asked` are people to be left out, `keys` what is removed and why, `absent` named ones that the
    data root does not have (KNOWN or UNKNOWN), `names` other names of what is removed, of which
    `other_names` are those people's, `counts` what else the summary says. `note` is what state/
    keeps of it, `scratch` a folder for work files; `keys_file` has the keys for worker processes.
    `changes` has the starts of the frames that change, by segment. `damage` says which raw data
    could not be read: everything that could be read was purged.
    """

    run: Run
    rules: PurgeRules
    listed: PurgeList | None
    frontier: Frontier
    scratch: Path
    dry: bool = False
    asked: PeopleList | None = None
    note: PurgeNote = field(default_factory=lambda: PurgeNote({}))
    keys: dict[str, str] = field(default_factory=dict)
    absent: dict[str, str] = field(default_factory=dict)
    names: Names = field(default_factory=dict)
    other_names: Names = field(default_factory=dict)
    changes: dict[Path, list[int]] = field(default_factory=dict)
    repeats: set[str] = field(default_factory=set)
    damage: DamagedData | None = None
    counts: dict[str, int] = field(default_factory=dict)

    @property
    def root(self) -> Path:
        """The data root."""
        return self.run.root

    @property
    def keys_file(self) -> Path:
        """The note in state/; in a dry run a copy elsewhere."""
        return (
            self.scratch / "keys.json" if self.dry else Layout(self.root).purge(self.rules.source)
        )

    @property
    def all_names(self) -> Names:
        """What leaves answers: the keys and the other names."""
        return {**self.names, "": self.keys}

    @property
    def removed(self) -> set[str]:
        """The keys of which the data root has something, or had before an interruption."""
        return {key for key in self.keys if key not in self.absent}

    def find_keys(self) -> None:
        """Find what is to be removed, with what an interrupted purge left."""
        # What an interrupted purge found out can't be found out again.
        self.note = unfinished(self.root, self.rules.source)
        self.keys = left = self.note.keys
        theirs = people(self, self.rules.people, self.asked) if self.rules.people else {}
        self.keys = left | theirs
        reasons = self.rules.find(self) | theirs | left
        self.absent = {key: why for key, why in reasons.items() if why in ABSENT}
        self.keys = {key: NAMED if why in ABSENT else why for key, why in reasons.items()}

    def begin(self) -> None:
        """Write the note of the purge, then tombstones of its keys."""
        if self.dry or self.keys:
            self.note.keys = self.keys | self.absent
            _write_note(self.keys_file, self.note)
        if self.keys and not self.dry:
            tombstones.add_tombstones(self.root, self.rules.source, self.keys.items())
        if self.keys:
            find_names = self.rules.answers.names
            names = find_names(self) if find_names else {}
            self.names = {**names, **self.other_names}

    def scan(self) -> None:
        """Find the answers that change, in worker processes if there are many, then say which
        entries of the lists name nothing. Changes nothing. Raises Interrupted, DamagedData.
        """
        paths = rawlog.all_segments(self.root, self.rules.source) if self.keys else []
        tasks = ((str(path), self.rules, str(self.keys_file), self.names) for path in paths)
        scans = list(purge_raw.over_segments(self.run, paths, scan_segment, tasks))
        self.changes = {path: scan.starts for path, scan in zip(paths, scans, strict=True)}
        self.repeats = set().union(*(scan.repeats for scan in scans))
        for key in set().union(*(scan.present for scan in scans)):
            del self.absent[key]
        say, absent = self.run.progress.say, self.absent
        if self.listed is not None:
            self.counts["bad_lines"] = self.listed.bad_lines
            warn(self.listed, {k: absent[k] for k in absent if not k.startswith(PERSON)}, say)
        if self.rules.people is not None and self.asked is not None:
            away = {k: absent[k] for k in absent if k.startswith(PERSON)}
            say_absent(self.rules.people, self.asked, away, say)

    def summary(self) -> dict[str, int]:
        """What became of the keys that the user named, how many left with them (`also`), and the
        lines that name nothing. People are known or unknown; what was purged are items.
        """
        became = Counter(self.absent.values())
        items = [why for key, why in self.keys.items() if not key.startswith(PERSON)]
        absent = sum(not key.startswith(PERSON) for key in self.absent)
        unread = self.listed.bad_lines if self.listed else 0
        return {
            "purged": items.count(NAMED) - absent,
            "also": len(items) - items.count(NAMED),
            "known": became[KNOWN],
            "unknown": became[UNKNOWN],
            "unread": unread + (len(self.asked.unread) if self.asked else 0),
        }


def unfinished(root: Path, source: str) -> PurgeNote:
    """The note of an interrupted purge, an empty one if there is none. Raises DamagedData."""
    hint = f"delete it, then run `kb purge {source}` again"
    return read_note(Layout(root).purge(source), PurgeNote, fix=hint) or PurgeNote({})


def note_keys(root: Path, source: str, keys: Mapping[str, str]) -> None:
    """Note a purge of these keys (key → reason), which `kb purge` has yet to do."""
    _write_note(Layout(root).purge(source), PurgeNote(dict(keys)))


def _write_note(path: Path, note: PurgeNote) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    write_bytes(path, msgspec.json.encode(note, order="sorted"))


def finish(purge: Purge) -> None:
    """After the last step: say in manifests what was removed, compact the state and remove the
    note.

    Raises WriterLocked and DiskFull.
    """
    root, source, note = purge.root, purge.rules.source, purge.note
    for name, text in note.files.items():
        if not (root / name).exists():
            write_bytes(root / name, text.encode())
    for name, made in note.manifests.items():
        if manifest.read_manifest(root, name) is None:
            manifest.write_vacant(root, made)
    with lock.writer(root, source):
        frontier = Frontier(Layout(root).state(source))
        try:
            frontier.forget()
            Layout(root).purge(source).unlink(missing_ok=True)
        finally:
            frontier.close()


# -- steps -----------------------------------------------------------------------------------------


def answers(purge: Purge) -> Iterator[PurgeLine]:
    """The raw answers that have a key are written again without, segment by segment.

    Raises Interrupted, DiskFull.
    """
    source = purge.rules.source
    for path, starts in purge.changes.items():
        if starts and not purge.dry:
            signals.stop.raise_if_asked()
            place = path.parent.name, rawlog.base_name(path)
            # A shorter segment than the state knows would count as lost. Killed here, the same
            # command reads it again.
            purge.frontier.set_offset(*place, 0)
            strip = partial(purge.rules.strip, path.parent.name, names=purge.all_names)
            with partition.without_collecting():
                purge_raw.rewrite_segment(path, starts, strip)
            purge.frontier.set_offset(*place, path.stat().st_size)
    for kind in rawlog.kinds(purge.root, source):
        changes = (len(n) for path, n in purge.changes.items() if path.parent.name == kind)
        yield PurgeLine(str(BELOW.raw(source, kind)), "answers", sum(changes))


class SegmentScan(NamedTuple):
    """What a purge finds in a segment: the starts of the frames that change, those of the UNKNOWN
    keys that they have, and the ids that `repeats` yields.
    """

    starts: list[int]
    present: set[str]
    repeats: set[str]


def scan_segment(segment: str, rules: PurgeRules, keys_file: str, names: Names) -> SegmentScan:
    """What a purge finds in a segment. Runs in a worker. Raises DamagedData."""
    path, scanned, sought = Path(segment), SegmentScan([], set(), set()), defaultdict(set)
    keys, matches = _keys(keys_file, rules, names)
    for key in (key for key, why in keys.items() if why == UNKNOWN):
        for text in rules.answers.texts([key]) or ():
            sought[text].add(key)

    def strip(envelope: Envelope) -> Envelope | None:
        if rules.answers.repeats:
            scanned.repeats.update(rules.answers.repeats(envelope, keys))
        return rules.strip(path.parent.name, envelope, {**names, "": keys})

    with partition.without_collecting():
        for start, line, envelope in purge_raw.changed_frames(path, matches, strip):
            scanned.starts.append(start)
            named = (sought[text] for text in matches.texts(line) if text in sought)
            for key in set().union(*named) - scanned.present if sought else ():
                if rules.strip(path.parent.name, envelope, {"": {key}}) is not envelope:
                    scanned.present.add(key)
    return scanned


def _keys(file: str, rules: PurgeRules, names: Names) -> tuple[dict[str, str], Matcher]:
    """The keys of a purge with their reasons, and what finds answers that may have a name."""
    about = Path(file).stat()
    others = frozenset[str]().union(*names.values())
    return _read_keys(file, rules, others, (about.st_mtime_ns, about.st_ino))


@lru_cache(maxsize=1)
def _read_keys(
    file: str, rules: PurgeRules, others: frozenset[str], _: tuple[int, int]
) -> tuple[dict[str, str], Matcher]:
    keys = msgspec.json.decode(Path(file).read_bytes(), type=PurgeNote).keys
    texts = rules.answers.texts(keys) if keys else ()
    return keys, purge_raw.Matcher(texts if texts is None else {*texts, *others})


def derived(purge: Purge) -> Iterator[PurgeLine]:
    """Everything that is made of the source goes as a whole; the rows that it has of the keys.

    A dry run counts those of releases as well, which are copies of the others.
    """
    rules, root = purge.rules, purge.root
    names = [
        name
        for name, artifact in ARTIFACTS.items()
        if artifact.maker and rules.source in sources_of(name)
    ]
    locations = (*rules.rows, *(released(rules.rows) if purge.dry else ()))
    with suppress(DamagedData):  # whatever a damaged table holds goes with it
        for line in drop_rows(root, filter(_is_derived, locations), purge.keys, dry=True):
            yield PurgeLine(*line)
    if purge.dry:
        for name in names:
            if not ARTIFACTS[name].tables and name != RELEASE:
                folder = ARTIFACTS[name].folder(root)
                files = [folder] if folder.is_file() else files_below(folder, root, strict=False)
                yield PurgeLine(name, "files, made again", sum(1 for _ in files))
        return
    for name in selected_from(root, rules.source):
        freshness.note_purged(purge.run, name)
    for place in _note_derived(purge, names):
        place.unlink(missing_ok=True)
    for name in names:
        if ARTIFACTS[name].public and name in purge.note.manifests:
            manifest.write_vacant(root, purge.note.manifests[name])
        if name != RELEASE:  # what it wrote lies in the folders of the others
            remove_path(ARTIFACTS[name].folder(root))
    for name in ARTIFACTS:
        kind, _, own = name.partition("/")
        if kind == "index" and rules.source in sources_of(name):
            index.remove(root, own)  # one in the user's cache as well


def _note_derived(purge: Purge, names: Iterable[str]) -> list[Path]:
    """Record how the artifacts that are about to be removed were made, and the files of theirs that
    are kept. Returns the files that lie outside their folders, behind links to another disk.
    """
    note, root, linked = purge.note, purge.root, list[Path]()
    note.keys = purge.keys | purge.absent
    for name in names:
        artifact = ARTIFACTS[name]
        made = Manifest(name) if artifact.folder(root).exists() and name != RELEASE else None
        with suppress(DamagedData):  # then nobody knows how it was made
            made = manifest.read_manifest(root, name) or made
        if made is not None:
            note.manifests[name] = manifest.without_files(made)
            here = artifact.folder(root).resolve()
            linked += [
                place
                for file in made.files
                if not (place := (here / file).resolve()).is_relative_to(here)
            ]
        for file in artifact.kept_files:
            if (path := artifact.folder(root) / file).is_file():
                note.files[f"{name}/{file}"] = path.read_text(encoding="utf-8")
    _write_note(purge.keys_file, note)
    return linked


def kept(purge: Purge) -> Iterator[PurgeLine]:
    """Rows of tables that can't be made again."""
    locations = [place for place in purge.rules.rows if not _is_derived(place)]
    chosen = selected_from(purge.root, purge.rules.source)
    locations += locations_in(chosen)
    if purge.dry:
        yield from _rows(purge, locations)
        return
    folders = [purge.root / location.folder for location in locations]
    for folder in folders:
        for work in folder.parent.glob(".work*"):
            shutil.rmtree(work, ignore_errors=True)  # of an interrupted restore, which asks again
    names = {match[1].name for folder in folders if (match := artifact_of(folder / "rows"))}
    with manifest.editing(purge.root, *sorted(names)):
        yield from _rows(purge, locations)
        for name in chosen:
            drop_described(purge.root, name, purge.keys)


def _rows(purge: Purge, locations: Iterable[RowLocation]) -> Iterator[PurgeLine]:
    lines = drop_rows(purge.root, locations, purge.keys, dry=purge.dry)
    return (PurgeLine(*line) for line in lines)


def _is_derived(location: RowLocation) -> bool:
    match = artifact_of(Path(location.folder, "rows"))
    return match is None or match[1].maker is not None


def state(purge: Purge) -> None:
    """Items of the frontier, and bytes that nobody can read and that may hold a key."""
    quarantine.remove_quarantined(purge.root, purge.rules.source)
    for kind in purge.rules.items:
        purge.frontier.remove(kind, purge.keys)
    if purge.rules.forget:
        purge.rules.forget(purge)
