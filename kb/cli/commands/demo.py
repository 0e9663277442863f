"""`kb demo`: the whole job on the sandbox. No key, no network."""

from __future__ import annotations

import contextlib
import os
import shutil
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

from kb.cli.commands.demo_root import FINISHED, without_scores
from kb.cli.framework.command import command, group
from kb.cli.framework.options import CLUSTER
from kb.cli.framework.options import pipeline as shipped
from kb.core.sources import SOURCES, made_of

if TYPE_CHECKING:
    from collections.abc import Collection, Sequence

    from kb.cli.framework.options import Options
    from kb.core.context import Run
    from kb.core.verdict import Summary

app = group("The whole job on the sandbox: no key, no network, minutes.")

# Settings of the caller that the demo keeps; all others, credentials among them, are out of its
# sight.
_KEPT = {"kb_data", "kb_now", "source_date_epoch"}
_DUMPS = "dumps"


@command(
    app,
    raw=True,
    uses=CLUSTER,
    json="steps, requests, root, and the summary of each step",
    examples=[
        (
            "kb demo                     under data/demo; a finished demo starts afresh,"
            " a stopped one goes on"
        ),
        "kb demo --data /tmp/try     under /tmp/try/demo",
        "kb demo --profile gardening/profile.toml     the same in a world made of that profile",
    ],
)
def demo(options: Options) -> Summary:
    """Crawl invented services with the real clients, and go all the way to a report and queries.

    It filters, exports, pairs, links, releases and reports, then queries the shards. Channels,
    pages and threads speak of the profile's keywords; a source that the profile leaves out is
    skipped. Everything goes to DIR/demo, by one process unless --workers says more. `.env` and
    credentials are ignored; nothing leaves this machine.
    """
    return play(options)


def play(options: Options, without: Collection[str] = (), **size: Any) -> Summary:
    """The demo without some steps, in a world of that size (n_channels …; kb.sandbox.world)."""
    from kb.cli.commands.profile.check import refuse
    from kb.core.profile import DEFAULT, load_profile
    from kb.core.settings import Settings
    from kb.sandbox.domain import domain_of
    from kb.sandbox.reddit.service import dumps
    from kb.sandbox.server import Sandbox
    from kb.sandbox.wiki.generated import PAGES
    from kb.sandbox.world import World

    for name in set(Settings.model_fields) - _KEPT:
        os.environ.pop(name.upper(), None)
    profile = load_profile(options.profile or DEFAULT)
    refuse(profile)
    with Sandbox(World(domain=domain_of(profile), n_named=PAGES, **size)) as services:
        settings = services.settings() | _model(options)
        os.environ |= settings  # worker processes read them too
        _begin(_root(options))
        run = _run(options, settings)
        pipeline = shipped(run, "demo")
        given = {"reddit import": {"files": dumps(services.world.reddit, run.root / _DUMPS)}}
        steps = [step for step in pipeline.STEPS if step not in without]
        return _all(steps, pipeline.QUERIES, run, services.ledger, given)


def _model(options: Options) -> dict[str, str]:
    """The tiny toxicity model, made at the first time;
    nothing where its packages are not installed.
    """
    from kb.core.errors import MissingExtra
    from kb.sandbox import toxicity

    _say(options, "the tiny toxicity model (made once, the same everywhere)")
    try:
        return toxicity.settings()
    except MissingExtra as error:
        _say(options, f"left out: {error}; {error.hint}")
        return {}


def _root(options: Options) -> Path:
    from kb.core.settings import load_settings

    data = options.data or load_settings(dotenv=False).kb_data
    return data.expanduser().absolute() / "demo"


def _run(options: Options, settings: dict[str, str]) -> Run:
    from dataclasses import replace

    from kb.core.profile import DEFAULT

    given = options.profile or DEFAULT
    # So small a world is done before worker processes have imported what they need.
    alone = 1 if options.engine == "local" else None
    made = replace(
        options, data=_root(options), profile=given, workers=options.workers or alone
    ).make_run(dotenv=False)
    run = replace(made, asked=options.workers is not None)
    if "KB_TOXICITY_MODEL" in settings:
        return run
    return replace(run, profile=without_scores(run.profile))


def _begin(root: Path) -> None:
    """Room for a new demo where the last one was finished; one that was stopped goes on."""
    from kb.store.layout import TOP

    if (root / FINISHED).exists():
        for name in (_DUMPS, *TOP):
            shutil.rmtree(root / name, ignore_errors=True)
        (root / FINISHED).unlink()


def _all(
    steps: Sequence[str],
    queries: list[tuple[str, str, list[str]]],
    run: Run,
    ledger: Any,
    given: dict[str, dict[str, Any]],
) -> Summary:
    """Every step, with the arguments `given` to some."""
    from kb.core.errors import MissingExtra
    from kb.core.verdict import Summary
    from kb.store.atomic import write_text
    from kb.store.layout import Layout

    done = Summary()
    for step in steps:
        if lacking := _lacking(run, step):
            print(f"\n== kb {step}\nleft out: the profile has no [{lacking}]", flush=True)
            continue
        print(f"\n== kb {step}", flush=True)
        try:
            summary = Summary(_command(step)(_at_work(run, step), **given.get(step, {})) or {})
        except MissingExtra as error:
            # An optional part of the installation: the other steps go on without it.
            summary = Summary(left_out=f"{error}; {error.hint}")
        done[step] = dict(summary)
        print(summary.line(), flush=True)
    _queries(queries, run.root)
    page = Layout(run.root).page
    print(f"\nTables, figures and releases are in {run.root}; open {page}")
    write_text(run.root / FINISHED, "")
    return Summary(
        {
            "command": "demo",
            "steps": len(done),
            "requests": len(ledger),
            "root": str(run.root),
            **done,
        }
    )


def _at_work(run: Run, step: str) -> Run:
    """A page of the wiki is mostly waited for, so two browsers take half the time of one."""
    from dataclasses import replace

    return replace(run, workers=2) if step == "wiki crawl" and not run.asked else run


def _lacking(run: Run, step: str) -> str | None:
    """The section of the profile that a step goes by, where there is none."""
    words = step.split()
    needed = {"pairs": (*made_of("pairs"), "pairs"), "links": ("pairs",)}.get(step, tuple(words))
    sections = (*SOURCES, "pairs")
    return next(
        (one for one in needed if one in sections and getattr(run.profile, one) is None), None
    )


def _command(step: str) -> Any:
    """The function behind a command, as kb/cli declares it."""
    import importlib

    from kb.cli.app import TREE

    source, _, name = step.partition(" ")
    module = importlib.import_module(TREE[source][0])
    return getattr(module, {"filter": "filter_", "import": "import_"}.get(name, name) or source)


def _queries(queries: list[tuple[str, str, list[str]]], root: Path) -> None:
    from kb.query import connect, found, select
    from kb.query.write import for_people

    held = {view.full for view in found(root)}
    with contextlib.closing(connect(root)) as db:
        for question, sql, needed in queries:
            if held.issuperset(needed):
                print(f"\n== {question}")
                print(f'kb query --data {root} "{" ".join(sql.split())}"')
                sys.stdout.writelines(for_people(select(db, sql)))


def _say(options: Options, text: str) -> None:
    if not options.quiet:
        print(text, file=sys.stderr, flush=True)
