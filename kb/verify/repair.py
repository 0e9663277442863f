"""What `kb verify --repair` sets aside of a data root; pipelines/verify.py makes the rest again.

Nothing is deleted that a command can't make again, and foreign files are never touched: what is
damaged gets the ending `.damaged`, or is noted for the next crawl or build.
"""

from collections.abc import Iterable, Iterator
from pathlib import Path

import msgspec

from kb.artifacts import manifest
from kb.core.errors import DamagedData
from kb.core.sources import SOURCES
from kb.store.artifact_registry import ARTIFACTS, MANIFEST, Artifact, artifact_of
from kb.store.damage import note_damage
from kb.store.layout import Layout
from kb.store.rawlog import sidefiles
from kb.verify.findings import Findings, VerifyFinding


def set_aside(root: Path, findings: Findings) -> list[str]:
    """Set damaged files of kept folders aside, and note those of derived ones; a line for each of
    the first. Raises DiskFull.
    """
    damaged = [finding for finding in findings.entries if finding.state != "foreign"]
    lost = [finding.path for finding in damaged if finding.kind in ("captures", "images")]
    lines = []
    for finding in damaged:
        if finding.kind == "tombstones":
            lines.append(f"{finding.path} is not repaired: {finding.advice}")
        elif finding.kind == "state" and finding.state == "damaged":
            lines += _state(root, finding)
    for artifact, paths in _by_artifact(damaged):
        if artifact.maker is None:
            lines += [f"{path} was set aside: {artifact.hint}" for path in _drop(artifact, paths)]
        else:
            lost += paths
            artifact_manifest = artifact.folder(root) / MANIFEST
            if artifact_manifest in paths:  # without it the artifact was never made
                artifact_manifest.unlink(missing_ok=True)
    note_damage(root, lost)
    return lines


def lost_sources(root: Path, findings: Findings) -> list[str]:
    """The sources whose raw answers or state are damaged."""
    damaged = [
        finding
        for finding in findings.of_kinds("raw answers", "state")
        if finding.state != "foreign"
    ]
    return [
        source
        for source in SOURCES
        if any(
            finding.path.is_relative_to(Layout(root).raw(source))
            or finding.path == Layout(root).state(source)
            for finding in damaged
        )
    ]


def damaged_artifacts(root: Path, findings: Findings) -> dict[str, Path | None]:
    """The derived artifacts that are damaged, inputs first; with each a foreign file that would go
    if it was made again.
    """
    damaged = {
        artifact.name: artifact.folder(root)
        for artifact, _ in _by_artifact(
            finding for finding in findings.entries if finding.state != "foreign"
        )
        if artifact.maker is not None
    }
    foreign = [
        finding.path
        for finding in findings.entries
        if finding.state == "foreign" and finding.kind != "leftovers"
    ]
    return {
        name: next((path for path in foreign if path.is_relative_to(damaged[name])), None)
        for name in ARTIFACTS
        if name in damaged
    }


def _by_artifact(findings: Iterable[VerifyFinding]) -> Iterator[tuple[Artifact, list[Path]]]:
    """The artifacts of these findings, each with the paths of its own."""
    paths: dict[str, list[Path]] = {}
    for finding in findings:
        # A finding may be about the folder as a whole.
        if match := artifact_of(finding.path) or artifact_of(finding.path / MANIFEST):
            paths.setdefault(match[1].name, []).append(finding.path)
    yield from ((ARTIFACTS[name], own) for name, own in paths.items())


def _drop(artifact: Artifact, paths: Iterable[Path]) -> list[Path]:
    """Set damaged files of a kept artifact aside; its manifest lists them no longer."""
    paths = sorted(paths)
    match = artifact_of(paths[0])
    assert match is not None
    root = match[0]
    for path in paths:
        sidefiles.quarantine_file(path)
    try:
        made = manifest.read_manifest(root, artifact.name)
    except DamagedData:
        artifact.manifest(root).unlink()
        made = None
    if made is not None:
        folder = artifact.folder(root)
        left = {name: entry for name, entry in made.files.items() if folder / name not in paths}
        manifest.write_manifest(artifact.manifest(root), msgspec.structs.replace(made, files=left))
    return paths


def _state(root: Path, finding: VerifyFinding) -> list[str]:
    path = finding.path
    if path.parent.name == "manifests":  # without it the artifact was never made
        path.unlink()
        return [f"{path} was removed: the next export writes it again"]
    if path.suffix != ".sqlite":
        return [f"{path} is not repaired: {finding.advice}"]
    for ending in ("-wal", "-shm"):
        path.with_name(path.name + ending).unlink(missing_ok=True)
    sidefiles.quarantine_file(path)
    return [f"{path} was set aside; it is replayed from {Layout(root).raw(path.stem)}"]
