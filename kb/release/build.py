"""`kb release`: the gate, then everything around the data of each folder.

release(run)     gate → describe each folder → gate over what was written
describe(run)    the files around the data alone (also after a purge)
"""

import logging
from collections.abc import Sequence

import pyarrow as pa

from kb.artifacts import domain_binding, freshness, manifest
from kb.artifacts.release_folder import (
    TOMBSTONES,
    ReleaseFolder,
    read,
    tombstone_lines,
)
from kb.core.context import Run
from kb.core.errors import ReleaseRefused, UsageError
from kb.core.licences import KNOWN
from kb.core.progress import Task
from kb.core.sources import PUBLISHED, exported_by, made_of
from kb.core.summary import Summary
from kb.release import folders, provenance, sample
from kb.release.gate import GateProblem, check
from kb.release.metadata import measure
from kb.release.metadata.card import card, citation, datasheet, law
from kb.release.metadata.croissant import croissant
from kb.release.metadata.measure import Facts
from kb.release.metadata.zenodo import deposit
from kb.schema import table
from kb.store.artifact_registry import SUMS
from kb.store.atomic import write_text
from kb.store.layout import Layout
from kb.store.lock import RELEASES
from kb.store.state import tombstones
from kb.store.tables.checksums import listed
from kb.store.tables.reading import reading

_log = logging.getLogger(__name__)


def release(run: Run, only: Sequence[str] = ()) -> Summary:
    """Check and describe every exported folder, or `only` those of some sources.

    Raises ReleaseRefused with `.problems`, UsageError.
    """
    with domain_binding.writing(run, *RELEASES):
        return _release(run, only)


def _release(run: Run, only: Sequence[str]) -> Summary:
    exports = exported(run, only)
    refuse(check.check(run, exports))
    lacking = " and ".join(run.profile.release.unsigned())
    if lacking:
        _log.warning(
            "the profile has no %s; `kb release publish` refuses a release without it:"
            " add [[release.creators]] and release.contact",
            lacking.replace("a ", "").replace(" and ", " and no "),
        )
    facts = [write(run, folder) for folder in exports]
    refuse(check.check_made(run, [read(folder.path, folder.source) for folder in exports]))
    freshness.note_described(run, (folder.source for folder in exports))
    return Summary(
        command="release",
        folders=len(exports),
        rows=sum(one.rows for one in facts),
        bytes=sum(one.size for one in facts),
        sandbox_model="yes, not for publication" if any(one.sandbox for one in facts) else None,
        sources={
            one.source: {table.table.short: table.rows for table in one.tables} for one in facts
        },
    )


def describe(run: Run, sources: Sequence[str] = ()) -> None:
    """Write the files around the data again, without the gate: after a purge took rows out."""
    described = [one for one in folders.in_root(run.root) if not sources or one.source in sources]
    for folder in described:
        write(run, folder)
    if described:
        freshness.note_described(run, (folder.source for folder in described))


def exported(run: Run, only: Sequence[str] = ()) -> list[ReleaseFolder]:
    """The folders to release, or `only` those of some sources.

    Raises ReleaseRefused when nothing was exported, a folder that was has lost its data, or
    something that they are made of is out of date; UsageError for a source that was not exported.
    """
    at, exports = Layout(run.root), folders.in_root(run.root)
    there = {folder.source for folder in exports}
    wanted = only or PUBLISHED
    refuse(
        [
            GateProblem("missing", str(at.release(source)), _lost(source))
            for source in wanted
            if source not in there and manifest.read(run.root, f"release/{source}")
        ]
    )
    if not exports:
        raise ReleaseRefused(
            f"there is nothing to release under {at.release()}",
            hint="run an export first, such as `kb youtube export`",
        )
    if strange := sorted(set(only) - there):
        raise UsageError(
            f"there is no folder {', '.join(strange)} in {at.release()}",
            hint=f"exported: {', '.join(folder.source for folder in exports)}",
        )
    exports = [folder for folder in exports if folder.source in wanted]
    stale = freshness.stale(run, *(f"release/{folder.source}" for folder in exports))
    refuse(
        [
            GateProblem("out of date", name, ", ".join(why))
            for name, why in stale.items()
            if not all(one.endswith("is missing") for one in why)  # the gate looks at files
        ],
        hint="run `kb build`, which makes what is out of date",
    )
    return exports


def _lost(source: str) -> str:
    made = exported_by(source)
    return f"was exported and is not there; run `{made}`, or name the other folders with --only"


def refuse(problems: Sequence[GateProblem], hint: str = "nothing was published") -> None:
    """Raise ReleaseRefused when there are problems; they are in its `.problems` and `.summary`."""
    if not problems:
        return
    lines = list(dict.fromkeys(str(problem) for problem in problems))
    count = f"{len(lines)} {'reason' if len(lines) == 1 else 'reasons'}"
    error = ReleaseRefused(f"the release is refused for {count}", hint=hint)
    error.problems = lines  # type: ignore[attr-defined]
    error.summary = Summary(command="release", problems=lines)
    raise error


def write(run: Run, folder: ReleaseFolder) -> Facts:
    """Everything around one folder's data, the checksums last."""
    with run.progress.task(f"release {folder.source}", total=13, unit="files") as task:
        return _describe(run, folder, task)


def _describe(run: Run, folder: ReleaseFolder, task: Task) -> Facts:
    with reading(shard for part in folder.parts for shard in part.shards):
        facts = measure.measure(run, folder)
    for path in folder.path.glob("LICENSE-*.txt"):
        path.unlink()
    version = run.profile.release.version
    changed = provenance.changes(run.root, folder, facts, version)
    texts = {
        "README.md": card(run, facts, changed),
        "DATASHEET.md": datasheet(run, facts),
        "CITATION.cff": citation(run, facts),
        "LICENSE": law(run, facts),
        "croissant.json": croissant(run, facts),
        folders.DEPOSIT: deposit(run, facts),
        **{
            f"LICENSE-{name}.txt": KNOWN[name].text
            for name, _ in facts.licences
            if name in KNOWN and name != facts.licence
        },
        **provenance.files(run, folder.source, changed),
    }
    if provenance.KEYWORDS not in texts:
        (folder.path / provenance.KEYWORDS).unlink(missing_ok=True)
    for name, text in texts.items():
        write_text(folder.path / name, text)
        task.advance()
    _tombstones(run, folder)
    sample.write(folder, run.profile.release.sample_mb)
    write_text(folder.path / SUMS, listed(folder.files()))
    provenance.record(run.root, folder, facts, version)
    task.advance(3)
    return facts


def _tombstones(run: Run, folder: ReleaseFolder) -> None:
    """Keys removed since collection began, of whatever the folder names."""
    declared = table("shared/tombstones")
    parts = [tombstones.read(run.root, source) for source in made_of(folder.source)]
    rows = pa.concat_tables([part.select(declared.names(released=True)) for part in parts])
    write_text(folder.path / TOMBSTONES, tombstone_lines(rows))
