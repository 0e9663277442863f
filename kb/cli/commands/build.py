"""`kb build`: makes what is out of date, in order, and says why; `kb update`: crawls first."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any

import typer

from kb.cli.framework.command import command, group
from kb.cli.framework.messages import ending, find_command, show
from kb.cli.framework.options import CLUSTER, Plan, pipeline
from kb.core.context import Run
from kb.core.errors import (
    GLOBAL_STOPS,
    FatalError,
    KbError,
    NothingKept,
    SettingError,
    Stopped,
    severity,
)
from kb.core.sources import PUBLISHED, SOURCES
from kb.core.summary import Summary

app = group("Make everything that is out of date, in order.")


@command(
    app,
    uses=CLUSTER,
    json="made, current, failed, steps (each with artifact, reasons and outcome)",
    planned=("names",),
    checks=True,
    examples=[
        "kb build                       filters, exports, pairs … and the release",
        "kb build --plan                what would be made, and why",
        "kb build pairs                 pairs with release/pairs, and all that they need",
        "kb build text                  the export format text, which is made only on request",
    ],
)
def build(
    run: Run,
    names: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="[NAME]...",
            help="youtube, wiki, reddit, pairs, tasks, links, index, report, release, or an export"
            " format. [default: all but the formats]",
        ),
    ] = None,
    plan: Annotated[
        bool, typer.Option("--plan", help="Print what would be made and why; write nothing.")
    ] = False,
) -> Summary:
    """Make what is out of date: filters, exports, pairs, tasks, links, index, report, release.

    Out of date is what was made from other inputs, from other values of the profile or of keyword
    files, or by older rules. What turns out to have the same inputs after all is left as it is. A
    source without raw data is left out. After a failure everything that does not depend on it is
    still made; the same command resumes.
    """
    from kb.artifacts import freshness
    from kb.artifacts.resumable_build import clear_finished
    from kb.store.artifact_registry import ARTIFACTS

    graph = freshness.graph(run, names or ())
    if not graph:
        what = " and ".join(names or ()) or "anything"
        raise FatalError(
            f"{run.root} has no raw data to make {what} from",
            hint="run a crawl or an import first, or `kb demo` to see the whole job",
        )
    outdated = freshness.plan(run, graph)
    steps = [{"artifact": name, "reasons": why} for name, why in outdated.items()]
    if plan:
        for line in freshness.lines(outdated):
            show(line)
        return Summary(command="build --plan", current=len(graph) - len(outdated), steps=steps)
    for name in graph:
        if name in ARTIFACTS and name not in outdated:
            clear_finished(run.root, name)
    return _make(run, len(graph), outdated, steps)


def _make(
    run: Run, size: int, outdated: dict[str, list[str]], steps: list[dict[str, Any]]
) -> Summary:
    """Make the outdated ones of `size` artifacts, each if it is still out of date when its turn
    comes; each of `steps` gets its outcome.
    """
    from kb.artifacts import freshness
    from kb.store.artifact_registry import ARTIFACTS

    lost: dict[str, KbError] = {}  # artifacts that are not there in today's form, and why
    failures: list[tuple[str, KbError]] = []
    summary = Summary(command="build", made=0, current=size - len(outdated), failed=0, steps=steps)
    for name, step in zip(outdated, steps, strict=True):
        inputs = ARTIFACTS[name].inputs if name in ARTIFACTS else list(outdated)
        if without := [one for one in inputs if one in lost]:
            lost[name] = lost[without[0]]
            step["outcome"] = f"left out: {without[0]} failed"
            run.progress.say(f"{name} is left out, because {without[0]} failed")
            continue
        if not freshness.reasons(run, name):
            step["outcome"] = "unchanged"
            summary["current"] += 1
            continue
        run.progress.say(f"{name}: {', '.join(step['reasons'])}")
        try:
            _make_one(run, name)
        except Stopped as error:  # a full disk, a signal, a cluster: it concerns what follows too
            failures.append((name, error))
            step["outcome"] = f"stopped: {error}"
            break
        except KbError as error:
            failures.append((name, error))
            step["outcome"] = f"failed: {error}"
            run.progress.say(f"{name} failed: {error}")
            for line in getattr(error, "problems", []):
                show(line, err=True)
            if not isinstance(error, NothingKept):  # its tables are there, without rows
                lost[name] = error
                summary["failed"] += 1
                continue
        else:
            step["outcome"] = "made"
        summary["made"] += 1
    if not failures:
        return summary
    name, worst = min(failures, key=lambda one: severity(one[1]))
    if not isinstance(worst, Stopped):
        more = f" (and {len(failures) - 1} more)" if len(failures) > 1 else ""
        worst = FatalError(f"{name}{more} failed: {worst}", hint=worst.hint)
    worst.summary = summary
    raise worst


def _make_one(run: Run, name: str) -> None:
    """Make one artifact by the code of its command."""
    from kb.artifacts import domain_binding, freshness
    from kb.export import layouts

    kind, _, rest = name.partition("/")
    if kind == "clean":
        from kb.filters.filter_run import check_kept, run_clean

        check_kept(run, rest, run_clean(run, rest))
    elif kind == "index":
        from kb.search.build import follow

        follow(run, rest)
    elif kind == "report":
        from kb.report.build import report

        report(run)
    elif name == freshness.RELEASE:
        pipeline(run, "release").release(run, [])
    elif kind in ("pairs", "tasks", "links"):
        room = pipeline(run, kind)
        with domain_binding.writing(run, kind, f"release-{kind}"):
            room.build(run) if kind == "pairs" else room.tables(run)
    else:
        of = rest if kind == "release" else freshness.made_from(name)
        layout = "parquet" if kind == "release" else rest.partition("/")[0]
        owner = PUBLISHED[of].part_of
        locks = [f"release-{one}" for one in (of, owner) if one]
        with domain_binding.writing(run, *locks):
            layouts.export(run, of, layout)


update_app = group("Do what is due: crawl what is new, refresh, purge, build.")


@command(
    update_app,
    uses=(*CLUSTER, "wait"),
    json="sources (the summaries of each source's steps), made, current, failed, steps",
    planned=("sources",),
    checks=True,
    examples=[
        "kb update                      for a timer: see docs/recurring.md",
        "kb update reddit --wait        one source; sleep until its limit is reset",
        "kb update --plan               what it would ask for, and what it would make",
    ],
)
def update(
    run: Run,
    sources: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="[SOURCE]...", help="youtube, wiki or reddit. [default: all crawled ones]"
        ),
    ] = None,
    plan: Plan = False,
) -> Summary:
    """Bring a data root up to date, as a timer does.

    It reads again what is older than the services' terms allow, crawls what is new, purges what was
    deleted there, then builds. Only sources that this data root has crawled through a service. A
    crawl keeps to --ids, --titles, --part and --since of the newest one, and to no --until. What
    ends one source does not keep the others and the build from going on, and the next run goes on
    there. The exit code is 1 where something failed, else 4 where somebody has to act (such as a
    captcha), else 3 where a quota or limit passes with time.
    """
    chosen = _crawled_sources(run, sources or [])
    if plan:
        return _planned_update(run, chosen)
    done: dict[str, dict[str, Any]] = {name: {} for name in chosen}
    failures: list[tuple[str, KbError]] = []
    for name, step in ((one, step) for one in chosen for step in _steps_of(one)):
        if not step.startswith("purge ") and any(name in one.split() for one, _ in failures):
            continue  # what is known to be gone goes all the same
        run.progress.say(f"kb {step}")
        crawls = step.endswith(" crawl")
        # An unfinished round goes on; a finished one is followed by the next.
        as_run = replace(run, again=crawls)
        try:
            command_: Any = find_command(step.split())
            bounds = _as_before(run, name) if crawls else {}
            done[name][step] = command_.function(as_run, **bounds)
        except KbError as error:
            failures.append((step, error))
            done[name][step] = (error.summary or {}) | ending(error, str(error))
            run.progress.say(f"kb {step}: {error}")
            if isinstance(error, GLOBAL_STOPS):
                break
    summary = Summary(command="update", sources=done)
    if not any(isinstance(error, GLOBAL_STOPS) for _, error in failures):
        try:
            built: dict[str, Any] = build(run)
        except KbError as error:
            failures.append(("build", error))
            built = error.summary or {}
        summary |= {name: value for name, value in built.items() if name != "command"}
    if not failures:
        return summary
    step, worst = min(failures, key=lambda one: severity(one[1]))
    message, hint = f"kb {step}: {worst}", worst.hint or "the next run goes on there"
    if isinstance(worst, Stopped):
        worst.args = (message,)
    else:
        worst = FatalError(message)
    worst.hint, worst.summary = hint, summary
    raise worst


def _steps_of(source: str) -> list[str]:
    """The commands that ask the service, in order: first what its terms ask for, as a crawl may
    spend the quota, then what removes.
    """
    refresh = [f"refresh {source}"] if SOURCES[source].refreshed else []
    return [*refresh, f"{source} crawl", f"purge {source}"]


def _as_before(run: Run, source: str) -> dict[str, Any]:
    """The options of the source's newest crawl that bound what it collects. Raises FatalError."""
    from kb.crawl.job import ASKED
    from kb.store.layout import Layout
    from kb.store.tables import reading

    with reading.state(Layout(run.root).state(source)) as frontier:
        bounds: dict[str, Any] = frontier.cursor(ASKED, {}, of=dict[str, str])
    for name in {"ids", "titles"} & bounds.keys():
        bounds[name] = Path(bounds[name])
        if not bounds[name].exists():
            raise FatalError(
                f"the list {bounds[name]} of the last crawl is gone",
                hint=f"restore it, or run `kb {source} crawl` once without a list",
            )
    return bounds


def _crawled_sources(run: Run, asked: list[str]) -> list[str]:
    """The sources that were crawled through a service, with what asking it again needs.

    Raises SettingError, FatalError without any, MissingCredential.
    """
    from kb.store.layout import Layout
    from kb.store.tables import reading

    if unknown := [name for name in asked if name not in SOURCES]:
        raise SettingError(
            f"there is no source {unknown[0]!r}", hint=f"known: {', '.join(SOURCES)}"
        )
    crawled = []
    for name in SOURCES:
        if (state := Layout(run.root).state(name)).is_file():
            with reading.state(state) as frontier:
                if frontier.requests()[0]:
                    crawled.append(name)
    chosen = [name for name in crawled if not asked or name in asked]
    if lacking := [name for name in asked if name not in crawled]:
        raise FatalError(
            f"{lacking[0]} was not crawled into {run.root} through its service",
            hint=f"run `kb {lacking[0]} crawl` first",
        )
    if not chosen:
        raise FatalError(
            f"nothing was crawled into {run.root} through a service",
            hint="run a crawl first; `kb build` makes what is out of date",
        )
    for name in chosen:
        SOURCES[name].connector(run).identity()
    return chosen


def _planned_update(run: Run, chosen: list[str]) -> Summary:
    """What the crawls and refreshes would ask for, and what a build would make now."""
    from kb.artifacts import freshness

    phases, assumed = [], []
    for name in chosen:
        for step in _steps_of(name)[:-1]:  # what was deleted is known after a refresh
            command_: Any = find_command(step.split())
            bounds = _as_before(run, name) if step.endswith(" crawl") else {}
            if "ids" not in bounds:  # of all remaining work
                bounds.pop("part", None)
            planned = command_.function(run, plan=True, **bounds)
            phases += [{**one, "phase": f"{step}: {one['phase']}"} for one in planned["phases"]]
            assumed += [planned["assumed"]] if planned.get("assumed") else []
    outdated = freshness.plan(run, freshness.graph(run))
    for line in freshness.lines(outdated):
        show(line)
    sums = {
        name: round(sum(one.get(name, 0) for one in phases), 3)
        for name in ("requests", "units", "hours", "gb")
    }
    steps = [{"artifact": name, "reasons": why} for name, why in outdated.items()]
    about = {"command": "update --plan", "source": "", **sums, "steps": steps}
    return Summary(about, phases=phases, assumed=", ".join(dict.fromkeys(assumed)) or None)
