"""`kb build`: makes what is out of date, in order, and says why."""

from __future__ import annotations

from typing import Annotated, Any

import typer

from kb.cli.framework.command import command, group
from kb.cli.framework.messages import show
from kb.cli.framework.options import CLUSTER, pipeline
from kb.core.context import Run
from kb.core.errors import FatalError, KbError, NothingKept, Stopped
from kb.core.sources import PUBLISHED
from kb.core.summary import Summary

app = group("Make everything that is out of date, in order.")


@command(
    app,
    uses=CLUSTER,
    json="made, current, failed, steps (each with artifact, reasons and outcome)",
    planned=("names",),
    needs_data=True,
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
    from kb.artifacts.table_catalog import Catalog

    if Catalog(run.root.absolute()).is_download:
        raise FatalError(f"{run.root} is a download", hint="only a data root can be built")
    graph = freshness.graph(run, names or ())
    if not graph:
        what = " and ".join(names or ()) or "anything"
        raise FatalError(
            f"{run.root} has no raw data to make {what} from",
            hint="run a crawl or an import first, or `kb demo` to see the whole job",
        )
    found = freshness.plan(run, graph)
    steps = [{"artifact": name, "reasons": why} for name, why in found.items()]
    if plan:
        for line in freshness.lines(found):
            show(line)
        return Summary(command="build --plan", current=len(graph) - len(found), steps=steps)
    return _make(run, len(graph), found, steps)


def _make(run: Run, size: int, found: dict[str, list[str]], steps: list[dict[str, Any]]) -> Summary:
    """Make what was found, of `size` artifacts, as far as it is still out of date when its turn
    comes; each of `steps` gets its outcome.
    """
    from kb.artifacts import freshness
    from kb.store.artifact_registry import ARTIFACTS

    lost: dict[str, KbError] = {}  # artifacts that are not there in today's form, and why
    failures: list[tuple[str, KbError]] = []
    summary = Summary(command="build", made=0, current=size - len(found), failed=0, steps=steps)
    for name, step in zip(found, steps, strict=True):
        inputs = ARTIFACTS[name].inputs if name in ARTIFACTS else list(found)
        if without := [one for one in inputs if one in lost]:
            lost[name] = lost[without[0]]
            step["outcome"] = f"left out: {without[0]} failed"
            run.progress.say(f"{name} is left out, because {without[0]} failed")
            continue
        if not (why := freshness.reasons(run, name)):
            step["outcome"] = "unchanged"
            summary["current"] += 1
            continue
        run.progress.say(f"{name}: {', '.join(why)}")
        try:
            _make_one(run, name)
        except Stopped as error:
            error.summary = summary
            raise
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
    name, first = failures[0]
    more = f" (and {len(failures) - 1} more)" if len(failures) > 1 else ""
    ended = FatalError(f"{name}{more} failed: {first}", hint=first.hint)
    ended.summary = summary
    raise ended


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
