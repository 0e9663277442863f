"""`kb merge`, `kb refresh`, `kb purge`, `kb verify`: what keeps a data root whole and lawful."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from kb.cli.framework.command import command, group
from kb.cli.framework.messages import show, show_row, with_options
from kb.cli.framework.options import CLUSTER, Options, Plan
from kb.core import terminal
from kb.core.config.pipeline import Recipe
from kb.core.context import Run
from kb.core.errors import DamagedData
from kb.core.sources import SOURCES, SourceDeclaration
from kb.core.summary import Summary

if TYPE_CHECKING:
    from kb.verify.findings import Findings, VerifyFinding


_SHOWN = 10  # findings of one kind in a folder

refresh_app = group("Re-read data that the services' terms require to be fresh.")

OlderThan = Annotated[
    int | None,
    typer.Option(
        "--older-than",
        min=0,
        metavar="DAYS",
        help="Re-read data older than this; 0: all of it. [default: the profile's max_age_days]",
    ),
]


@command(
    refresh_app,
    "youtube",
    uses=("wait",),
    limit="Stop after N more videos (exit code 3); the next run resumes.",
    json="crawled, missing, failed, pending, requests, units",
    planned=("older_than",),
    examples=[
        "kb refresh youtube --wait",
        "kb refresh youtube --limit 5000",
        "kb refresh youtube --older-than 7        also view counts older than a week",
    ],
)
def refresh_youtube(run: Run, older_than: OlderThan = None, plan: Plan = False) -> Summary:
    """Re-read metadata older than the profile's max_age_days, and mark videos that are gone.

    Costs one unit of the general quota for 50 videos. A smaller --older-than also re-reads the
    counts of videos whose metadata are fresh, from the separate quota for statistics.
    Run `kb youtube filter` and `kb youtube export` afterwards.
    """
    from kb.youtube.crawl.refresh import plan_refresh, refresh

    do = plan_refresh if plan else refresh
    return do(run, older_than)


@command(
    refresh_app,
    "reddit",
    uses=(*CLUSTER, "wait"),
    limit="Stop after N more posts and comments (exit code 3); the next run resumes.",
    again="Select once more what is due, including what was missing last time, instead of resuming"
    " a stopped refresh.",
    json="crawled, missing, failed, pending, requests",
    planned=(*CLUSTER, "older_than", "again"),
    examples=[
        "kb refresh reddit --wait",
        "kb refresh reddit --older-than 0         everything, now: a removal request came in",
    ],
)
def refresh_reddit(run: Run, older_than: OlderThan = None, plan: Plan = False) -> Summary:
    """Re-read scores, removals and deletions with your own app's key, 100 ids per request.

    Run `kb reddit filter` and `kb reddit export` afterwards.
    """
    from kb.reddit.crawl.refresh import refresh
    from kb.reddit.plan import plan_refresh

    return plan_refresh(run, older_than) if plan else refresh(run, older_than)


def _refresh(source: SourceDeclaration) -> Callable[..., Summary]:
    def refresh(run: Run, older_than: OlderThan = None, plan: Plan = False) -> Summary:
        from kb.crawl.job import crawl_source
        from kb.crawl.session import replay_unread_answers
        from kb.registry import SOURCES as CLASSES

        connector = CLASSES[source.name].connector(run)
        age = getattr(run.profile.section(source.name), "max_age_days", 30)
        connector.refresh(age if older_than is None else older_than)
        command_, kinds = f"refresh {source.name}", [source.refreshed]
        if plan:
            replay_unread_answers(run, source.name, CLASSES[source.name].connector)
            return connector.plan(command_, kinds)
        return crawl_source(run, source, connector, command_, kinds)

    return refresh


for _source in SOURCES.values():
    if _source.refreshed and _source.name not in ("youtube", "reddit"):
        command(
            refresh_app,
            _source.name,
            help=f"Re-read {_source.noun(_source.refreshed)} older than the profile's max_age_days,"
            " and mark those that are gone.",
            uses=("wait",),
            limit="Stop after N more (exit code 3); the next run resumes.",
            json="crawled, failed, pending, requests, units",
            planned=("older_than",),
            examples=[f"kb refresh {_source.name} --wait"],
        )(_refresh(_source))


purge_app = group("Remove content that was deleted at its source or that a file names.")

Ids = Annotated[
    Path | None,
    typer.Option(
        "--ids",
        metavar="FILE",
        help="Also remove these ids: one per line, CSV, JSON or a Parquet file.",
    ),
]
PurgePlan = Annotated[
    bool,
    typer.Option(
        "--plan", help="Count what would be removed, by table and folder; change nothing."
    ),
]


def _purge(run: Run, source: str, ids: Path | None, people: Path | None, plan: bool) -> Summary:
    step = Recipe("purge").defined("plan" if plan else "purge")
    summary: Summary = step(run, source, ids, people)
    if not plan:
        return summary
    show_row(("folder", "what", "count"))
    for line in summary["lines"]:
        show_row((line["folder"], line["what"], line["count"]))
    return summary


def _purge_reddit(
    run: Run,
    ids: Ids = None,
    authors: Annotated[
        Path | None,
        typer.Option(
            "--authors",
            metavar="FILE",
            help="Also remove all that these people posted or commented, and never collect more"
            " of it: a name or the address of a profile per line.",
        ),
    ] = None,
    plan: PurgePlan = False,
) -> Summary:
    return _purge(run, "reddit", ids, authors, plan)


def _purge_youtube(
    run: Run,
    ids: Ids = None,
    channels: Annotated[
        Path | None,
        typer.Option(
            "--channels",
            metavar="FILE",
            help="Also remove all videos of these channels, and never collect more of them: an id"
            " or an address with /channel/ per line.",
        ),
    ] = None,
    plan: PurgePlan = False,
) -> Summary:
    return _purge(run, "youtube", ids, channels, plan)


def _by_ids(source: str) -> Callable[..., Summary]:
    def purge(run: Run, ids: Ids = None, plan: PurgePlan = False) -> Summary:
        return _purge(run, source, ids, None, plan)

    return purge


_OWN: dict[str, Callable[..., Summary]] = {"reddit": _purge_reddit, "youtube": _purge_youtube}


for _name, _source in SOURCES.items():
    command(
        purge_app,
        _name,
        help=_source.purge_help,
        uses=CLUSTER,
        json="purged, also, known, unknown, unread, rows, scores",
        planned=("ids", "authors", "channels"),
        examples=_source.purge_examples or (f"kb purge {_name} --ids ids.txt",),
    )(_OWN.get(_name) or _by_ids(_name))


verify_app = group("Find damaged, missing and foreign files in a data root or release.")


@command(
    verify_app,
    raw=True,
    resumable=False,
    json="files_whole, files_damaged, files_missing, files_foreign, kinds, found",
    data="reads",
    examples=[
        "kb verify                       the data root",
        "kb verify release/              a download, compared with its checksums",
        "kb verify --repair              rebuild or fetch again what is damaged or missing",
    ],
)
def verify(
    options: Options,
    folder: Annotated[
        Path | None,
        typer.Argument(
            metavar="[FOLDER]",
            help="A data root, a release folder, or a folder of releases. [default: the data root]",
        ),
    ] = None,
    repair: Annotated[
        bool,
        typer.Option(
            "--repair",
            help="Move damaged files aside and make derived data again; sends nothing.",
        ),
    ] = False,
) -> Summary:
    """Read every byte, and list files that are damaged, missing or foreign.

    Prints one line per kind of files, then one per problem with what to do about it. The exit code
    is 1 if there is a problem. Nothing is changed without --repair, which lists what was set aside
    and made again, and what a crawl or an import has to bring. It leaves foreign files alone: they
    are listed, and don't count as a problem.
    """
    from kb.artifacts.data_roots import is_root
    from kb.artifacts.table_catalog import empty

    options = replace(options, data=folder or options.data, use="writes" if repair else "reads")
    run = options.make_run(needs="profile" if repair else "root")
    place = run.root
    repairable = is_root(place)
    if repair and not repairable:
        raise empty(place)
    room = Recipe("verify")
    report: Findings
    repaired: list[str] = []
    if repair:
        report, repaired = room.defined("repair")(run)
    else:
        report = room.defined("verify")(run, place)
    run.progress.close()
    for line in terminal.table(list(report.table())):
        typer.echo(line)
    _show_findings(report.entries)
    for line in repaired:
        show(with_options(f"repair: {line}"))
    summary = Summary(command="verify", **report.summary(place), repaired=repaired)
    if any(not (repair and finding.state == "foreign") for finding in report.entries):
        counts = ", ".join(
            f"{files:,} {state}"
            for state in ("damaged", "missing", "foreign")
            if (files := report.total(state)[0])
        )
        hint = "`kb verify --repair` repairs what it can" if repairable and not repair else ""
        error = DamagedData(f"{place} has problems: {counts}", hint=hint)
        error.summary = summary
        raise error
    return summary


def _show_findings(findings: Iterable[VerifyFinding]) -> None:
    """A line for each file, but at most _SHOWN for those of a folder with the same problem."""
    alike = Counter[tuple[str, Path, str]]()
    for finding in findings:
        alike[finding.state, finding.path.parent, finding.what] += 1
        if alike[finding.state, finding.path.parent, finding.what] <= _SHOWN:
            show(with_options(f"{finding.state}: {finding.path}: {finding.what}; {finding.advice}"))
    for (state, folder, what), number in alike.items():
        if number > _SHOWN:
            show(f"{state}: {folder}: {number - _SHOWN:,} more files: {what}")


merge_app = group("Bring the data roots of several machines into one.")


@command(
    merge_app,
    raw=True,
    json="folders, files, present, bytes, requests, scores, films, labels, path",
    data="makes",
    examples=[
        "kb merge part-1 part-2 part-3 --data data    after crawls with --part on three machines",
        "kb merge /mnt/other/data                     what another machine has collected since",
    ],
)
def merge(
    options: Options,
    roots: Annotated[
        list[Path], typer.Argument(metavar="ROOT...", help="Data roots to read; they stay as is.")
    ],
) -> Summary:
    """Bring raw answers, tombstones, scores, labels and what was spent into the root of --data.

    Each answer and file is there once, whatever was merged before; after an interruption the same
    command resumes. The next crawl takes the answers into its state, and `kb SOURCE filter` reads
    them all as one. What was purged on one machine is purged from what the others bring. Roots of
    another profile, host or key of authors are refused.
    """
    from kb.artifacts import domain_binding, merge_roots
    from kb.labels import imports
    from kb.score import film_store
    from kb.store.layout import Layout

    run = options.make_run(needs="root")
    if options.profile is None and domain_binding.remembered(run.root) is None:
        bound = next(filter(None, map(domain_binding.remembered, roots)), None)
        named = (bound.file or bound.name) if bound else None
        run = options.make_run(kb_profile=named)
    summary = merge_roots.merge(run, roots)
    summary["films"] = film_store.unite(run, roots)
    summary["labels"] = imports.unite(run, roots)
    for source in SOURCES:
        if Layout(run.root).purge(source).exists() and getattr(run.profile, source) is not None:
            Recipe("purge").defined("purge")(run, source, None)
    return summary
