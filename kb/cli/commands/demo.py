"""`kb demo`: the whole job on the sandbox, without key or network."""

from __future__ import annotations

import contextlib
import os
import shutil
import sys
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from kb.cli.framework.command import command, group
from kb.cli.framework.demo_root import without_scores
from kb.cli.framework.messages import find_command
from kb.cli.framework.options import CLUSTER, Options, pipeline
from kb.core.context import Run
from kb.core.errors import MissingExtra, UsageError
from kb.core.sources import SOURCES, made_of
from kb.core.summary import Summary
from kb.store.layout import TOP, Layout

if TYPE_CHECKING:
    from collections.abc import Collection, Sequence

app = group("Run the whole job on the sandbox in minutes: no key, no network.")

# Settings that the demo keeps; all others, credentials included, are removed.
_KEPT = {"kb_data", "kb_now", "source_date_epoch"}
_DUMPS = "dumps"
_REMOVED = ".demo.old"  # what a demo that starts over moves out of the way
_ANSWERS = 3


@command(
    app,
    raw=True,
    uses=CLUSTER,
    json="steps, requests, root, and the summary of each step",
    examples=[
        (
            "kb demo                     in data/demo; starts over after a finished demo,"
            " else resumes"
        ),
        "kb demo --data /tmp/try     in /tmp/try/demo",
        "kb demo --profile gardening/profile.toml     in a world made from that profile",
    ],
)
def demo(options: Options) -> Summary:
    """Crawl invented services with the real clients, and go on to a report, queries and a search.

    Filters, exports, makes pairs, links, index, release and report, then queries the shards and
    searches the index. Channels, pages and threads mention the profile's keywords; sources that the
    profile leaves out are skipped. Everything goes to DIR/demo, in one process unless --workers is
    given. `.env` and credentials are ignored, and nothing leaves this machine.
    """
    return play(options)


def play(options: Options, without: Collection[str] = (), **size: Any) -> Summary:
    """The demo without some steps, in a world of this size (n_channels …; kb.sandbox.world)."""
    from kb.artifacts.table_catalog import is_root
    from kb.cli.commands.profile.check import refuse
    from kb.core.config.profile import DEFAULT, load_profile
    from kb.core.config.settings import Settings, load_settings
    from kb.sandbox.domain import domain_of
    from kb.sandbox.reddit.service import dumps
    from kb.sandbox.server import Sandbox
    from kb.sandbox.wiki.generated import PAGES
    from kb.sandbox.world import World
    from kb.store.state import demo_mark

    for name in set(Settings.model_fields) - _KEPT:
        os.environ.pop(name.upper(), None)
    data = options.data or load_settings(dotenv=False).kb_data
    root = data.expanduser().absolute() / "demo"
    options = replace(options, data=root, profile=options.profile or DEFAULT)
    profile = load_profile(options.profile or DEFAULT)
    refuse(profile)
    domain = domain_of(profile)
    words = next((one.name for one in domain.keywords), profile.title)
    with Sandbox(World(domain=domain, n_named=PAGES, **size)) as services:
        settings = services.settings() | _model(options)
        os.environ |= settings  # worker processes read them too
        mark = demo_mark.read(root)
        if mark is None and is_root(root):
            raise UsageError(
                f"{root} holds data that no demo has made", hint="name another folder with --data"
            )
        if mark is not None and mark.finished:
            _remove(root)
        demo_mark.write(root, finished=False)
        run = _run(options, settings)
        plan = pipeline(run, "demo")
        given = {"reddit import": {"files": dumps(services.world.reddit, run.root / _DUMPS)}}
        steps = [step for step in plan.STEPS if step not in without]
        return _all(steps, plan.QUERIES, words, run, services, given)


def _remove(root: Path) -> None:
    """Remove a demo's data. Each folder goes in one step, so that who reads it meanwhile, such as a
    running `kb explore`, finds all of it or none.
    """
    shutil.rmtree(root / _REMOVED, ignore_errors=True)  # of a demo that was killed here
    for name in (_DUMPS, *TOP):
        with contextlib.suppress(FileNotFoundError):
            os.rename(root / name, root / _REMOVED)
            shutil.rmtree(root / _REMOVED)


def _model(options: Options) -> dict[str, str]:
    """The tiny toxicity model's setting; none where its packages are not installed."""
    from kb.sandbox import toxicity

    _say(options, "the tiny toxicity model (made once, the same on every machine)")
    try:
        return toxicity.settings()
    except MissingExtra as error:
        _say(options, f"left out: {error}; {error.hint}")
        return {}


def _run(options: Options, settings: dict[str, str]) -> Run:
    # In so small a world one process is done before others have imported what they need.
    single = 1 if options.engine == "local" else None
    run = replace(options, workers=options.workers or single).make_run(dotenv=False)
    run = replace(run, asked=options.workers is not None)
    if "KB_TOXICITY_MODEL" in settings:
        return run
    return replace(run, profile=without_scores(run.profile))


def _all(
    steps: Sequence[str],
    queries: list[tuple[str, str, list[str]]],
    words: str,
    run: Run,
    services: Any,
    given: dict[str, dict[str, Any]],
) -> Summary:
    """Run every step, with the arguments `given` to some, then the queries, then search for
    `words`.
    """
    from kb.store.state import demo_mark

    done = Summary()
    for step in steps:
        print(f"\n== kb {step}", flush=True)
        if missing := _missing_section(run, step):
            print(f"left out: the profile has no [{missing}]", flush=True)
            continue
        # A browser mostly waits for a page, so two take half the time of one.
        of_step = replace(run, workers=2) if step == "wiki crawl" and not run.asked else run
        try:
            command: Any = find_command(step.split())
            if step == "release" and not run.profile.toxicity.on:
                summary = Summary(left_out="a release needs toxicity scores")
            else:
                summary = Summary(command.function(of_step, **given.get(step, {})) or {})
        except MissingExtra as error:  # the other steps work without it
            summary = Summary(left_out=f"{error}; {error.hint}")
        done[step] = dict(summary)
        print(summary.line(), flush=True)
    _queries(queries, run.root)
    if "index" in done and "left_out" not in done["index"]:
        _search(words, run.root)
    page = Layout(run.root).page
    print(f"\nTables, figures and releases are in {run.root}; open {page}")
    demo_mark.write(run.root, finished=True)
    about = {"steps": len(done), "requests": services.requests, "root": str(run.root)}
    return Summary({"command": "demo", **about, **done})


def _missing_section(run: Run, step: str) -> str | None:
    """A section that the step needs and the profile lacks."""
    needed = {
        "pairs": (*made_of("pairs"), "pairs"),
        "tasks": made_of("tasks"),
        "links": ("pairs",),
    }.get(step, step.split())
    sections = (*SOURCES, "pairs")
    return next(
        (one for one in needed if one in sections and getattr(run.profile, one) is None), None
    )


def _queries(queries: list[tuple[str, str, list[str]]], root: Path) -> None:
    from kb.query import connect, find_views, select
    from kb.query.output import for_people

    names = {view.full for view in find_views(root)}
    with contextlib.closing(connect(root)) as db:
        for question, sql, needed in queries:
            if names.issuperset(needed):
                print(f"\n== {question}")
                print(f'kb query --data {root} "{" ".join(sql.split())}"')
                sys.stdout.writelines(for_people(select(db, sql)))


def _search(words: str, root: Path) -> None:
    from kb.cli.commands.search import lines
    from kb.cli.framework.messages import show
    from kb.search.answers import search
    from kb.search.ranking import Only

    print(f"\n== What do videos, pages and threads say about {words}?")
    print(f'kb search --data {root} --limit {_ANSWERS} "{words}"')
    for number, answer in enumerate(search(root, words, only=Only(limit=_ANSWERS)), 1):
        for line in lines(number, answer):
            show(line)


def _say(options: Options, text: str) -> None:
    if not options.quiet:
        print(text, file=sys.stderr, flush=True)
