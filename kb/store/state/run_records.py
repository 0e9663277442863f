"""state/runs/: what each run of a command that writes left behind, the last 1,000.

A record has times, exit code, figures and the names of artifacts and of the profile's keys: no id,
no name, no SQL. A run that was killed leaves none.
"""

import hashlib
import os
from collections.abc import Iterator, Mapping
from datetime import datetime
from pathlib import Path
from typing import Any

import msgspec

from kb.core.config.profile import Profile
from kb.core.summary import phrases
from kb.store.atomic import write_bytes
from kb.store.damage import read_note
from kb.store.layout import Layout
from kb.version import __version__

MOST = 1000
_SETTINGS = "settings.json"
_MADE = ("made", "failed", "left out", "stopped")  # outcomes of a build's steps


class RunRecord(msgspec.Struct, frozen=True, omit_defaults=True):
    """One run; times in UTC, ISO 8601. `settings`: keys of the profile whose values differ from
    those of the run before, with the values where they are numbers.
    """

    command: str
    version: str
    start: str
    end: str
    seconds: float
    exit_code: int
    waits_for: str = ""
    figures: dict[str, Any] = {}
    made: dict[str, list[str]] = {}
    settings: list[str] = []


def figures(summary: Mapping[str, Any]) -> dict[str, Any]:
    """The numbers of a summary; under `sources` those of each source or of each of its steps."""
    numbers = {
        name: value
        for name, value in summary.items()
        if isinstance(value, (int, float)) and not isinstance(value, bool) and value
    }
    sources = summary.get("sources")
    parts = dict(_parts(sources)) if isinstance(sources, Mapping) else {}
    return {**numbers, "sources": parts} if parts else numbers


def _parts(sources: Mapping[str, Any]) -> Iterator[tuple[str, dict[str, Any]]]:
    for name, about in sources.items():
        if isinstance(about, Mapping):
            if own := figures({**about, "sources": None}):
                yield name, own
            else:  # an update has several steps of a source
                yield from _parts(about)


def in_words(record: Mapping[str, Any]) -> str:
    """Figures as people read them: "60 crawled, 8 requests; reddit crawl: 3 crawled"."""
    own = {name.replace("_", " "): record[name] for name in record if name != "sources"}
    words = [phrases.nouns(own)] if own else []
    parts = record.get("sources", {}).items()
    return "; ".join(words + [f"{name}: {in_words(part)}" for name, part in parts])


def made(summary: Mapping[str, Any]) -> dict[str, list[str]]:
    """The artifacts of a build by what became of them."""
    outcomes: dict[str, list[str]] = {}
    steps = summary.get("steps")
    for step in steps if isinstance(steps, list) else ():
        outcome = str(step.get("outcome", ""))
        for word in _MADE:
            if outcome.startswith(word):
                outcomes.setdefault(word, []).append(step["artifact"])
    return outcomes


def keep(
    root: Path,
    profile: Profile,
    *,
    command: str,
    start: datetime,
    end: datetime,
    seconds: float,
    exit_code: int,
    summary: Mapping[str, Any],
) -> None:
    """Write the record of a run, and remove the oldest beyond `MOST`. Raises OSError, DamagedData,
    DiskFull.
    """
    folder = Layout(root).runs
    record = RunRecord(
        command=command,
        version=__version__,
        start=start.isoformat(timespec="seconds"),
        end=end.isoformat(timespec="seconds"),
        seconds=round(seconds, 1),
        exit_code=exit_code,
        waits_for=str(summary.get("waits_for") or ""),
        figures=figures(summary),
        made=made(summary),
        settings=_changed(folder / _SETTINGS, profile),
    )
    there = _files(folder)
    number = int(there[-1].name.partition("-")[0]) + 1 if there else 1
    # Two runs that end at once take the same number, and their processes tell them apart.
    write_bytes(folder / f"{number:08}-{os.getpid()}.json", msgspec.json.encode(record) + b"\n")
    for path in there[: max(0, len(there) + 1 - MOST)]:
        path.unlink(missing_ok=True)


def kept(root: Path) -> Iterator[RunRecord]:
    """The records, the newest first. Raises DamagedData."""
    for path in reversed(_files(Layout(root).runs)):
        record = read_note(path, RunRecord, fix=f"delete {path}")
        if record is not None:  # another process has removed it
            yield record


def made_in_words(record: RunRecord) -> str:
    """What a run made, in a few words."""
    words = [f"{outcome} {', '.join(names)}" for outcome, names in record.made.items()]
    words += [f"waits for {record.waits_for}"] if record.waits_for else []
    words += [in_words(record.figures)] if not record.made else []
    words += [f"changed: {', '.join(record.settings)}"] if record.settings else []
    return "; ".join(filter(None, words))


def _files(folder: Path) -> list[Path]:
    return sorted(path for path in folder.glob("[0-9]*-*.json"))


def _changed(path: Path, profile: Profile) -> list[str]:
    """What differs from the settings of the run before, which these replace."""
    now = dict(_values("", profile.model_dump(mode="json", exclude={"path"})))
    before = read_note(path, dict[str, Any], fix=f"delete {path}")
    if before != now:
        write_bytes(path, msgspec.json.encode(now) + b"\n")
    if before is None:
        return []
    changes = []
    for key in sorted(before.keys() | now.keys()):
        if before.get(key) != now.get(key):
            values = [before.get(key), now.get(key)]
            plain = not any(isinstance(value, str) for value in values)
            changes.append(f"{key} {values[0]} → {values[1]}" if plain else key)
    return changes


def _values(prefix: str, section: Mapping[str, Any]) -> Iterator[tuple[str, Any]]:
    """Every key by its full name: a number as it is, of anything else a digest."""
    for name, value in section.items():
        key = f"{prefix}{name}"
        if isinstance(value, dict) and value:
            yield from _values(f"{key}.", value)
        elif value is None or isinstance(value, (int, float)):
            yield key, value
        else:
            text = msgspec.json.encode(value, order="sorted")
            yield key, hashlib.sha256(text).hexdigest()[:16]
