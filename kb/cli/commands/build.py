"""`kb build`: makes what is out of date, in order, and says why; `kb update`: crawls first."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from kb.cli.framework.command import command, group
from kb.cli.framework.messages import ending, find_command, show
from kb.cli.framework.options import CLUSTER, Plan
from kb.core.config.pipeline import Recipe
from kb.core.context import Run
from kb.core.errors import (
    GLOBAL_STOPS,
    FatalError,
    KbError,
    ReleaseRefused,
    SettingError,
    Stopped,
    severity,
)
from kb.core.sources import SOURCES
from kb.core.summary import Summary

if TYPE_CHECKING:
    from kb.artifacts.freshness import Reasons

app = group("Make everything that is out of date, in order.")


@command(
    app,
    uses=CLUSTER,
    json="made, current, failed, steps (each with artifact, reasons and outcome);"
    " with --plan also to_make and obstacles, with --graph artifacts",
    planned=("names",),
    checks=True,
    examples=[
        "kb build                       filters, exports, pairs … and the release",
        "kb build --plan                what would be made, and why",
        "kb build pairs                 pairs with release/pairs, and all that they need",
        "kb build text                  the export format text, which is made only on request",
        "kb build --graph --out g.svg   what is made of what, and what is current",
    ],
)
def build(
    run: Run,
    names: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="[NAME]...",
            help=f"{', '.join(SOURCES)}, pairs, tasks, links, index, report, release, or an export"
            " format. [default: all but the formats]",
        ),
    ] = None,
    plan: Annotated[
        bool, typer.Option("--plan", help="Print what would be made and why; write nothing.")
    ] = False,
    graph: Annotated[
        bool,
        typer.Option("--graph", help="Print what is made of what, how, and what is current."),
    ] = False,
    out: Annotated[
        Path | None,
        typer.Option("--out", metavar="FILE.svg", help="With --graph: draw it there."),
    ] = None,
) -> Summary:
    """Make what is out of date: filters, exports, pairs, tasks, links, index, report, release.

    Out of date is what was made from other inputs, from other values of the profile or of keyword
    files, by another recipe or by older rules. What turns out to have the same inputs after all is
    left as it is. A source without raw data is left out. After a failure everything that does not
    depend on it is still made; the same command resumes.
    """
    from kb.artifacts import freshness

    if out is not None and (not graph or out.suffix != ".svg"):
        raise SettingError(
            "--out is for the drawing of --graph", hint="write --graph --out FILE.svg"
        )
    if graph:
        return _graph(run, names or (), out)
    artifacts = freshness.graph(run, names or ())
    if not artifacts:
        what = " and ".join(names or ()) or "anything"
        raise FatalError(
            f"{run.root} has no raw data to make {what} from",
            hint="run a crawl or an import first, or `kb demo` to see the whole job",
        )
    outdated = freshness.plan(run, artifacts)
    if plan:
        return _planned(run, len(artifacts), outdated)
    return _make(run, len(artifacts), outdated)


def _graph(run: Run, names: Sequence[str], out: Path | None) -> Summary:
    """Print the graph, and draw it."""
    from kb.report.graph import CURRENT, nodes

    shown = nodes(run, names)
    for line in (line for node in shown for line in node.lines()):
        show(line)
    summary = Summary(
        command="build --graph",
        artifacts=[node._asdict() for node in shown],
        current=sum(node.state == CURRENT for node in shown),
    )
    if out is not None:
        from kb.report.graph import drawn
        from kb.store.atomic import write_bytes

        write_bytes(out, drawn(shown))
        summary["path"] = str(out)
    return summary


def _planned(run: Run, size: int, outdated: Reasons) -> Summary:
    """What stands in the way, then each artifact with its reasons, then how many will be made."""
    from kb.artifacts import freshness, makers

    in_the_way = makers.obstacles(run, outdated)
    for obstacle in in_the_way:
        show(str(obstacle))
    blocked = makers.made_of_these(
        [n for obstacle in in_the_way for n in obstacle.artifacts], outdated
    )
    for line in freshness.lines(outdated):
        show(line)
    return Summary(
        command="build --plan",
        to_make=len(outdated) - len(blocked),
        blocked=len(blocked),
        current=size - len(outdated),
        obstacles=[
            {"what": str(error), "fix": error.hint, "artifacts": names}
            for error, names in in_the_way
        ],
        steps=freshness.steps(outdated),
    )


def _make(run: Run, size: int, outdated: Reasons) -> Summary:
    """Make the outdated ones of `size` artifacts. Raises what `makers.failure` says."""
    from kb.artifacts import freshness
    from kb.artifacts.makers import FAILED, MADE, UNCHANGED, failure, make_outdated

    steps = freshness.steps(outdated)
    summary = Summary(command="build", made=0, current=size - len(outdated), failed=0, steps=steps)
    counted = {MADE: "made", UNCHANGED: "current", FAILED: "failed"}
    outcomes = []
    for outcome, step in zip(make_outdated(run, outdated), steps, strict=False):
        outcomes.append(outcome)
        step["outcome"] = str(outcome)
        if outcome.outcome in counted:
            summary[counted[outcome.outcome]] += 1
    for outcome in outcomes:
        if isinstance(outcome.error, ReleaseRefused):
            for line in outcome.error.problems:
                show(line, err=True)
    if (ended := failure(outcomes)) is not None:
        ended.summary = summary
        raise ended
    return summary


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
            metavar="[SOURCE]...", help=f"{', '.join(SOURCES)}. [default: all crawled ones]"
        ),
    ] = None,
    plan: Plan = False,
) -> Summary:
    """Bring a data root up to date, as a timer does.

    It reads again what is older than the services' terms allow, crawls what is new, purges what was
    deleted there, then builds. Only sources that this data root has crawled through a service, and
    imported ones, whose folders and dumps are read again without a request. A crawl keeps to --ids,
    --titles, --part and --since of the newest one, and to no --until. What ends one source does not
    keep the others and the build from going on, and the next run goes on there. The exit code is 1
    where something failed, else 4 where somebody has to act (such as a captcha), else 3 where a
    quota or limit passes with time.
    """
    chosen = _steps_due(run, sources or [])
    if plan:
        return _planned_update(run, chosen)
    from kb.artifacts import freshness

    done: dict[str, dict[str, Any]] = {name: {} for name in chosen}
    failures: list[tuple[str, KbError]] = []
    for name, step in ((name, step) for name, steps in chosen.items() for step in steps):
        if not step.startswith("purge ") and any(name in failed.split() for failed, _ in failures):
            continue  # what is known to be gone goes all the same
        run.progress.say(f"kb {step}")
        try:
            done[name][step] = _step(run, name, step)
        except KbError as error:
            failures.append((step, error))
            done[name][step] = (error.summary or {}) | ending(error, str(error))
            run.progress.say(f"kb {step}: {error}")
            if isinstance(error, GLOBAL_STOPS):
                break
    summary = Summary(command="update", sources=done)
    if failures and not freshness.graph(run):
        run.progress.say("kb build: nothing to make yet, as no item has been read")
    elif not any(isinstance(error, GLOBAL_STOPS) for _, error in failures):
        try:
            built: dict[str, Any] = build(run)
        except KbError as error:
            failures.append(("build", error))
            built = error.summary or {}
        summary |= {name: value for name, value in built.items() if name != "command"}
    if failures:
        raise _worst(failures, summary)
    return summary


def _step(run: Run, source: str, step: str) -> Summary:
    """Run one command of an update."""
    # An unfinished round continues; after a finished one the next begins.
    as_run = replace(run, again=step.endswith(" crawl"))
    if step.startswith("purge "):  # what it removes is made again by the build at the end
        purged: Summary = Recipe("purge").defined("purge")(as_run, source, None, build=False)
        return purged
    command_: Any = find_command(step.split())
    made: Summary = command_.function(as_run, **_as_before(run, source, step))
    return made


def _worst(failures: list[tuple[str, KbError]], summary: Summary) -> KbError:
    """The failure that decides the exit code, with the step in its message."""
    step, worst = min(failures, key=lambda failure: severity(failure[1]))
    message, hint = f"kb {step}: {worst}", worst.hint or "the next run goes on there"
    if isinstance(worst, Stopped):
        worst.args = (message,)
    else:
        worst = FatalError(message)
    worst.hint, worst.summary = hint, summary
    return worst


def _steps_of(source: str, *, crawled: bool, imported: bool) -> list[str]:
    """The commands that bring a source up to date, in order: what is read from files, what the
    service's terms ask for, as a crawl may spend the quota, what is new there, and what removes.
    """
    reads = [f"{source} import"] * imported
    asks = [*([f"refresh {source}"] if SOURCES[source].refreshed else []), f"{source} crawl"]
    return [*reads, *(asks if crawled else ()), f"purge {source}"]


def _as_before(run: Run, source: str, step: str) -> dict[str, Any]:
    """The arguments of the source's newest crawl that bound what it collects, or of its imports.

    Raises FatalError.
    """
    from kb.crawl.job import ASKED, IMPORTED
    from kb.store.layout import Layout
    from kb.store.tables import reading

    with reading.state(Layout(run.root).state(source)) as frontier:
        bounds: dict[str, Any] = frontier.cursor(ASKED, {}, of=dict[str, str])
        given = frontier.cursor(IMPORTED, {}, of=dict[str, list[str]])
    if step.endswith(" import"):
        spans = {name: given.pop(name)[0] for name in ("since", "until") if given.get(name)}
        paths = {name: [Path(text) for text in texts] for name, texts in given.items() if texts}
        if missing := [path for some in paths.values() for path in some if not path.exists()]:
            raise FatalError(
                f"{missing[0]}, which was imported before, is gone",
                hint=f"restore it, or run `kb {source} crawl`, which asks the service",
            )
        return {**paths, **spans}
    if not step.endswith(" crawl"):
        return {}
    for name in {"ids", "titles"} & bounds.keys():
        bounds[name] = Path(bounds[name])
        if not bounds[name].exists():
            raise FatalError(
                f"the list {bounds[name]} of the last crawl is gone",
                hint=f"restore it, or run `kb {source} crawl` once without a list",
            )
    return bounds


def _steps_due(run: Run, asked: list[str]) -> dict[str, list[str]]:
    """By source, what brings it up to date: of those that were crawled through a service, with what
    asking it again needs, and of imported ones.

    Raises SettingError, FatalError without any, MissingCredential.
    """
    from kb.crawl.job import IMPORTED
    from kb.crawl.session import replay_unread_answers
    from kb.registry import SOURCES as CLASSES
    from kb.store.layout import Layout
    from kb.store.tables import reading

    if unknown := [name for name in asked if name not in SOURCES]:
        raise SettingError(
            f"there is no source {unknown[0]!r}", hint=f"known: {', '.join(SOURCES)}"
        )
    steps = {}
    for name in SOURCES:
        replay_unread_answers(run, name, CLASSES[name].connector)
        if not (state := Layout(run.root).state(name)).is_file():
            continue
        with reading.state(state) as frontier:
            crawled, imported = bool(frontier.requests()[0]), bool(frontier.cursor(IMPORTED))
        if (crawled or imported) and (not asked or name in asked):
            steps[name] = _steps_of(name, crawled=crawled, imported=imported)
            if crawled:
                CLASSES[name].connector(run).identity()
    if lacking := [name for name in asked if name not in steps]:
        raise FatalError(
            f"{lacking[0]} was neither crawled nor imported into {run.root}",
            hint=f"run `kb {lacking[0]} crawl` first",
        )
    if not steps:
        raise FatalError(
            f"nothing was crawled or imported into {run.root}",
            hint="run a crawl or an import first; `kb build` makes what is out of date",
        )
    return steps


def _planned_update(run: Run, chosen: Mapping[str, list[str]]) -> Summary:
    """What the crawls and refreshes would ask for, and what a build would make now."""
    from kb.artifacts import freshness
    from kb.core.summary.plan import PlanPhase

    phases: list[dict[str, Any]] = []
    assumed: list[str] = []
    for name, due in chosen.items():
        for step in due[:-1]:  # what was deleted is known after a refresh
            arguments = _as_before(run, name, step)
            if step.endswith(" import"):
                paths = sum(len(some) for some in arguments.values() if not isinstance(some, str))
                phases.append(PlanPhase(f"{step}: folders and files", paths)._asdict())
                continue
            command_: Any = find_command(step.split())
            if "ids" not in arguments:  # of all remaining work
                arguments.pop("part", None)
            as_run = replace(run, again=step.endswith(" crawl"))
            planned = command_.function(as_run, plan=True, **arguments)
            phases += [
                {**phase, "phase": f"{step}: {phase['phase']}"} for phase in planned["phases"]
            ]
            assumed += [planned["assumed"]] if planned.get("assumed") else []
    outdated = freshness.plan(run, freshness.graph(run))
    steps = _planned(run, len(outdated), outdated)["steps"]
    sums = {
        name: round(sum(phase.get(name, 0) for phase in phases), 3)
        for name in ("requests", "units", "hours", "gb")
    }
    about = {"command": "update --plan", "source": "", **sums, "steps": steps}
    return Summary(about, phases=phases, assumed=", ".join(dict.fromkeys(assumed)) or None)
