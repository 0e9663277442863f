"""`kb doctor`: whether this machine has what a long crawl needs, one line for each thing."""

from __future__ import annotations

import contextlib
import importlib.metadata
import os
import platform
import shutil
import stat
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from kb.cli.framework.command import command, group
from kb.cli.framework.messages import show, warn
from kb.cli.framework.options import Options
from kb.core import terminal
from kb.core.errors import (
    DamagedData,
    FatalError,
    KbError,
    SettingError,
    UsageError,
)
from kb.core.sources import SOURCES
from kb.core.summary import Summary
from kb.net import redact

if TYPE_CHECKING:
    from kb.core.config.settings import Settings
    from kb.core.context import Run

app = group("Check what a long crawl needs: programs, disk, model, credentials, services.")

OK, NOTE, PROBLEM = "ok", "note", "problem"
Line = tuple[str, str, str, str]  # state, what, what was found, what to do
_FILES = 1024  # open files of a crawl with its browsers and of an index
_PACKAGES = ("duckdb", "numpy", "pyarrow", "selenium", "torch", "typer", "zstandard")
_REMOTE = ("nfs", "nfs4", "cifs", "smb3", "9p", "fuse.sshfs", "lustre", "gpfs", "beegfs", "ceph")


@command(
    app,
    raw=True,
    uses=("engine", "scheduler"),
    resumable=False,
    json="checks (each state, what, found, fix), problems",
    data="ignores",
    examples=[
        "kb doctor                                this machine, the data root and the settings",
        "kb doctor --online                       and each service of the profile, asked once",
        "kb doctor --engine dask --scheduler tcp://10.0.0.1:8786     and each worker",
    ],
)
def doctor(
    options: Options,
    online: Annotated[
        bool,
        typer.Option("--online", help="Ask each service of the profile once (1 search unit)."),
    ] = False,
) -> Summary:
    """Print one line for each thing that a long crawl needs, with what to do where it is missing.

    Secrets are never shown, so the output can go into a bug report. The exit code is 1 if something
    stands in the way; credentials that are not set and a data root that is yet to be made don't.
    """
    lines: list[Line] = []
    for line in _all(options, online):
        lines.append(line)
        if not options.json:
            state, what, value, fix = line
            show(f"{state:<8} {what}: {value}" + (f"; {fix}" if fix else ""))
    names = ("state", "what", "found", "fix")
    problems = sum(state == PROBLEM for state, *_ in lines)
    summary = Summary(
        command="doctor",
        checks=[dict(zip(names, line, strict=True)) for line in lines],
        problems=problems,
    )
    if not problems:
        return summary
    first = next(line for line in lines if line[0] == PROBLEM)
    error = FatalError(f"{first[1]}: {first[2]}", hint=first[3])
    error.summary = summary
    raise error


def _all(options: Options, online: bool) -> Iterator[Line]:
    yield from _installation()
    try:
        run = replace(options, engine=type(options.engine).local, scheduler=None).make_run()
    except KbError as error:
        yield PROBLEM, "settings", str(error), error.hint
        return
    for name in sorted(run.settings.model_fields_set & {"kb_now", "source_date_epoch"}):
        yield NOTE, name.upper(), f"set to {getattr(run.settings, name)}", "dates are not today's"
    yield OK, "profile", f"{run.profile.name} ({run.profile.path})", ""
    yield from _root(run)
    yield from _clock(run)
    yield from _programs(run)
    yield from _release(run)
    yield from _settings(run.settings)
    yield from _network(run)
    if options.engine != "local":
        yield from _workers(options, run)
    if online:
        from kb.cli.commands.profile_files import ask
        from kb.core.config.section import ERROR, WARNING

        for finding, _, _ in ask(run):
            state = PROBLEM if finding.level in (ERROR, WARNING) else OK
            yield state, finding.file.replace("online: ", "service "), finding.what, finding.fix


def _installation() -> Iterator[Line]:
    from kb.core.installation import code_digest
    from kb.version import __version__

    yield OK, "Lorecrawl", f"{__version__} (code {code_digest()[:12]})", ""
    python = f"{platform.python_version()} at {sys.executable}"
    if (3, 11) <= sys.version_info < (3, 15):
        yield OK, "Python", python, ""
    else:
        yield PROBLEM, "Python", python, "use Python 3.11 to 3.14"
    versions = []
    for name in _PACKAGES:
        with contextlib.suppress(importlib.metadata.PackageNotFoundError):
            versions.append(f"{name} {importlib.metadata.version(name)}")
    yield OK, "packages", ", ".join(versions), ""
    yield OK, "machine", f"{platform.platform()}, {os.cpu_count()} processors", ""
    with contextlib.suppress(ImportError):
        import resource

        limit, _ = resource.getrlimit(resource.RLIMIT_NOFILE)
        few = limit < _FILES
        fix = f"raise it: ulimit -n {4 * _FILES}" if few else ""
        yield PROBLEM if few else OK, "open files", f"{limit:,} at most", fix


def _root(run: Run) -> Iterator[Line]:
    """Write access, file system and free space of the data root or of where it would be made."""
    from kb.artifacts.table_catalog import refuse_download

    try:
        refuse_download(run.root, named="kb_data" in run.settings.model_fields_set)
    except UsageError as error:
        yield PROBLEM, "data root", str(error), error.hint
        return
    place = next(folder for folder in (run.root, *run.root.parents) if folder.exists())
    what = "data root" if place == run.root else "data root (yet to be made)"
    kind = _file_system(place)
    where = f"{run.root}" + (f" on {kind}" if kind else "")
    try:
        with tempfile.NamedTemporaryFile(dir=place, prefix=".doctor-", suffix=".tmp") as file:
            import fcntl

            fcntl.flock(file.fileno(), fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError as error:
        fix = "make it writable, or name another with --data"
        yield PROBLEM, what, f"{where}: {error.strerror or error}", fix
        return
    if kind in _REMOTE:
        yield NOTE, what, where, "a network's file system: one machine may write to it at a time"
    else:
        yield OK, what, where, ""
    yield from _links(run)
    yield from _disks(run, place)


def _links(run: Run) -> Iterator[Line]:
    """Links below raw/ to folders that can't be reached, or that lead back into the data root."""
    from kb.store.layout import Layout
    from kb.store.walk import walk

    try:
        for _ in walk(Layout(run.root).raw(), run.root):
            pass
    except DamagedData as error:
        yield PROBLEM, "links", str(error), error.hint


def _disks(run: Run, place: Path) -> Iterator[Line]:
    """Free space of each disk that raw data go to, against what crawls need."""
    disks: dict[int, tuple[Path, list[tuple[str, float]]]] = {place.stat().st_dev: (place, [])}
    for source, gb in _planned(run):
        there = _written_to(run, source)
        disks.setdefault(there.stat().st_dev, (there, []))[1].append((source, gb))
    for there, planned in disks.values():
        free, needed = shutil.disk_usage(there).free, sum(gb * 1e9 for _, gb in planned)
        what = f"{terminal.size(free)} free" + (f" at {there}" if there != place else "")
        if planned:
            crawls = ", ".join(f"{source} {gb:.1f} GB" for source, gb in planned)
            what += f"; crawls need about {terminal.size(int(needed))} ({crawls})"
        fix = "free some, or take another --data"
        yield (PROBLEM, "disk", what, fix) if needed > free else (OK, "disk", what, "")


def _written_to(run: Run, source: str) -> Path:
    """Where a crawl writes most of its data: links may lead to another disk."""
    from kb.store.layout import CAPTURED, Layout

    at = Layout(run.root)
    place = at.captures if source == CAPTURED else at.raw(source)
    return next(folder for folder in (place, *place.parents) if folder.exists()).resolve()


def warn_of_space(run: Run, source: str) -> None:
    """Say in one line that a crawl may need more than is free; `--limit` asks for less anyway."""
    place = _written_to(run, source)
    free = shutil.disk_usage(place).free
    needed = next((gb * 1e9 for planned, gb in _planned(run) if planned == source), 0)
    if needed > free and run.limit is None:
        warn(
            f"the crawl needs about {terminal.size(int(needed))}, and {terminal.size(free)} are"
            f" free at {place}; it stops resumable when the disk is full"
        )


def _planned(run: Run) -> Iterator[tuple[str, float]]:
    """What the crawl of each source of the profile would add to raw/, in GB; sends nothing."""
    from kb.registry import SOURCES as CLASSES

    for name, source in CLASSES.items():
        if getattr(run.profile, name) is None:
            continue
        with contextlib.suppress(KbError):  # a damaged state: `kb verify` tells
            if (plan := source.plan(run)) is not None:
                yield name, float(plan["gb"])


def _file_system(place: Path) -> str:
    """The kind of file system that a folder is on, where Linux tells."""
    try:
        mounts = [line.split() for line in Path("/proc/mounts").read_text().splitlines()]
    except OSError:
        return ""
    path = str(place.resolve())
    inside = [
        mount for mount in mounts if path == mount[1] or path.startswith(mount[1].rstrip("/") + "/")
    ]
    return max(inside, key=lambda mount: len(mount[1]))[2] if inside else ""


def _clock(run: Run) -> Iterator[Line]:
    """Whether the clock is behind the newest file. (With `--online` certificates tell as well.)"""
    from kb.store.rawlog import rawlog

    now = datetime.now(UTC)
    written = [Path(__file__)]
    written += [path for source in SOURCES for path in rawlog.all_segments(run.root, source)]
    newest = datetime.fromtimestamp(max(path.lstat().st_mtime for path in written), UTC)
    shown = now.strftime("%Y-%m-%d %H:%M:%S UTC")
    if (newest - now).total_seconds() > 60:
        fix = f"set it: a file is from {newest:%Y-%m-%d %H:%M:%S}, and quotas are counted by day"
        yield PROBLEM, "clock", shown, fix
    else:
        yield OK, "clock", shown, ""


def _programs(run: Run) -> Iterator[Line]:
    """Browser and driver where the profile has a wiki, and the toxicity model."""
    from kb.registry import SOURCES as CLASSES

    for name, source in CLASSES.items():
        if getattr(run.profile, name) is not None:
            yield from source.requirements(run)
    if not run.profile.toxicity.on:
        yield OK, "toxicity model", "off in the profile", ""
        return
    from kb.store import checkpoint

    try:
        checkpoint.need_extra()
        model = checkpoint.find_checkpoint(run.settings)
        yield OK, "toxicity model", f"{model.model} ({model.path})", ""
    except (KbError, DamagedData) as error:
        yield PROBLEM, "toxicity model", str(error), error.hint


def _release(run: Run) -> Iterator[Line]:
    """Who releases the data, and under which licence."""
    section = run.profile.release
    unlicensed = section.unlicensed()
    lacking = [f"a licence of {', '.join(unlicensed)}"] if unlicensed else []
    lacking += section.unsigned()
    if not lacking:
        yield OK, "release", "licence, creator and contact are set", ""
        return
    fix = "name it in [release] of the profile; until then `kb build` makes all but the release"
    yield NOTE, "release", f"the profile lacks {', '.join(lacking)}", fix


def _settings(settings: Settings) -> Iterator[Line]:
    """Which credentials are set, never their values, and whether others can read them; endpoints
    that are not the public ones.
    """
    with contextlib.suppress(FileNotFoundError):
        if Path(".env").stat().st_mode & (stat.S_IRGRP | stat.S_IROTH):
            what = "other users of this machine can read it"
            yield NOTE, ".env", what, "run `chmod 600 .env`"
    for name, field in type(settings).model_fields.items():
        value = getattr(settings, name)
        if "SecretStr" in str(field.annotation) or name == "kb_contact":
            is_set = value is not None
            yield (
                OK if is_set else NOTE,
                name.upper(),
                "set" if is_set else "not set",
                "" if is_set else f"needed for: {field.description}",
            )
        elif name.endswith(("_endpoint", "_web", "_url")) and value is not None:
            yield NOTE, name.upper(), f"{value}", "not the public service"


def _network(run: Run) -> Iterator[Line]:
    """Whose certificates are trusted, and through which proxies services are asked."""
    from urllib.request import getproxies_environment

    from kb.net.certificates import authorities

    try:
        name, place = authorities()
        yield OK, "certificates", f"{place} ({name})" if place else "the usual authorities", ""
    except SettingError as error:
        yield PROBLEM, "certificates", str(error), error.hint
        return
    for kind, proxy in sorted(getproxies_environment().items()):
        what = "hosts that are asked directly" if kind == "no" else f"proxy of {kind}"
        yield OK, what, redact.text(proxy), ""


def _workers(options: Options, run: Run) -> Iterator[Line]:
    """A line for each worker of the cluster."""
    from kb.core.dask_engine import survey

    try:
        root = run.root if run.root.is_dir() else None
        for address, threads, why in survey(options.scheduler, root):
            fix = "install the same there, and start it again" if why else ""
            form = f"{threads} threads" + (f", {why}" if why else ", as here")
            yield PROBLEM if why else OK, f"worker {address}", form, fix
    except (KbError, SettingError) as error:
        yield PROBLEM, "cluster", str(error), error.hint
