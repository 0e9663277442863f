"""`kb demo`, the whole job on the sandbox, and `kb sandbox`, its services for any command."""

from __future__ import annotations

import contextlib
import json
import os
import shlex
import shutil
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from kb.cli.framework.command import command, group
from kb.cli.framework.messages import fail, find_command
from kb.cli.framework.options import CLUSTER, Options, without_scores
from kb.core import signals
from kb.core.config.pipeline import Recipe
from kb.core.context import Run
from kb.core.errors import MissingExtra, SettingError, UsageError
from kb.core.progress import Progress, span
from kb.core.sources import SOURCES, made_of
from kb.core.summary import Summary
from kb.store.layout import TOP, Layout

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Sequence

    from kb.sandbox.domain import Domain


demo_app = group("Run the whole job on the sandbox in minutes: no key, no network.")

# Settings that the demo keeps; all others, credentials included, are removed.
_KEPT = {"kb_data", "kb_now", "source_date_epoch"}
_DUMPS = "dumps"  # in the root of an older demo
_REMOVED = ".demo.old"  # what a demo that starts over moves out of the way
_ANSWERS = 2
_WHAT = """\
the whole job on invented services of this machine, a few minutes, without a network: crawls of
YouTube, a wiki and Reddit, filters, pairs, tasks, links, index, report, release, then queries"""


@command(
    demo_app,
    raw=True,
    uses=CLUSTER,
    json="steps, requests, root, and the summary of each step",
    data="makes",
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
    began = time.monotonic()
    _say(options, _WHAT)
    from kb.cli.commands.profile_files import refuse
    from kb.core.config.profile import DEFAULT, load_profile
    from kb.core.config.settings import DECLARED, load_settings
    from kb.sandbox.domain import domain_of
    from kb.sandbox.reddit.service import dumps
    from kb.sandbox.server import Sandbox
    from kb.sandbox.wiki.generated import PAGES
    from kb.sandbox.world import World

    for name in set(DECLARED.model_fields) - _KEPT:
        os.environ.pop(name.upper(), None)
    loaded = load_settings(dotenv=False, kb_data=options.data)
    data, named = loaded.kb_data.expanduser().absolute(), "kb_data" in loaded.model_fields_set
    root = data / "demo"
    options = replace(options, data=root, profile=options.profile or DEFAULT)
    profile = load_profile(options.profile or DEFAULT)
    refuse(profile)
    domain = domain_of(profile)
    words = next((keyword.name for keyword in domain.keywords), profile.title)
    with Sandbox(World(domain=domain, n_named=PAGES, **size)) as services:
        _say(options, "the tiny toxicity model (made once, the same on every machine)")
        settings = services.settings() | _tiny_model(lambda why: _say(options, f"left out: {why}"))
        os.environ |= settings  # worker processes read them too
        for place in (data, root):
            options.check_root(place, named=named)
        _begin(root)
        run = _run_of(options, scored="KB_TOXICITY_MODEL" in settings)
        job = Recipe("demo")
        steps = [step for step in job.defined("STEPS") if step not in without]
        # Beside the data root: in it they would hold what a purge removes everywhere else.
        place = root.with_name(f".{root.name}-dumps")
        try:
            given = {"reddit import": {"files": dumps(services.world.reddit, place)}}
            done = _all(steps, job.defined("QUERIES"), words, run, services, given)
            _say(options, f"the demo took {span(time.monotonic() - began)}")
            return done
        finally:
            shutil.rmtree(place, ignore_errors=True)


def _begin(root: Path) -> None:
    """Prepare a data root for a demo: remove a finished demo, keep an unfinished one so that it
    resumes, and mark the root. Raises UsageError if the root holds other data.
    """
    from kb.artifacts.data_roots import is_root
    from kb.store.state import demo_mark

    mark = demo_mark.read_mark(root)
    if mark is None and is_root(root):
        raise UsageError(
            f"{root} holds data that no demo has made", hint="name another folder with --data"
        )
    if mark is not None and mark.finished:
        _remove(root)
    demo_mark.write_mark(root, finished=False)


def _run_of(options: Options, *, scored: bool) -> Run:
    """The demo's run. Unless texts are `scored`, its profile does without toxicity scores."""
    # In so small a world one process is done before others have imported what they need.
    single = 1 if options.engine == "local" else None
    run = replace(options, workers=options.workers or single).make_run(dotenv=False)
    run = replace(run, asked=options.workers is not None)
    if not scored:
        run = replace(run, profile=without_scores(run.profile))
    if not sys.stderr.isatty():  # each step is a line of stdout, which is enough
        run = replace(run, progress=Progress())
    return run


def _remove(root: Path) -> None:
    """Remove a demo's data. Each folder goes in one step, so that who reads it meanwhile, such as a
    running `kb explore`, finds all of it or none.
    """
    shutil.rmtree(root / _REMOVED, ignore_errors=True)  # of a demo that was killed here
    for name in (_DUMPS, *TOP):
        with contextlib.suppress(FileNotFoundError):
            os.rename(root / name, root / _REMOVED)
            shutil.rmtree(root / _REMOVED)


def _tiny_model(missing: Callable[[str], None]) -> dict[str, str]:
    """The tiny toxicity model's setting; none, after a word, where its packages are missing."""
    from kb.sandbox import toxicity

    try:
        return toxicity.settings()
    except MissingExtra as error:
        missing(f"{error}; {error.hint}")
        return {}


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
        if missing := _missing_section(run, step):
            print(f"{step}: left out: the profile has no [{missing}]", flush=True)
            continue
        # A browser mostly waits for a page, so two take half the time of one.
        of_step = replace(run, workers=2) if step == "wiki crawl" and not run.asked else run
        try:
            command: Any = find_command(step.split())
            summary = Summary(command.function(of_step, **given.get(step, {})) or {})
        except MissingExtra as error:  # the other steps work without it
            summary = Summary(command=step, left_out=f"{error}; {error.hint}")
        done[step] = dict(summary)
        print(summary.line(), flush=True)
    _queries(queries, run.root)
    if "index" in done and "left_out" not in done["index"]:
        _search(words, run.root)
    page = Layout(run.root).page
    print(f"\nTables, figures and releases are in {run.root}; open {page}")
    demo_mark.write_mark(run.root, finished=True)
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
        (
            source
            for source in needed
            if source in sections and getattr(run.profile, source) is None
        ),
        None,
    )


def _queries(queries: list[tuple[str, str, list[str]]], root: Path) -> None:
    from kb.query import connect, find_views, select
    from kb.query.formats import for_people

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


sandbox_app = group("Serve invented YouTube, wiki and Reddit on this machine.")

# An invented release must reach no real service; an empty token wins over one of `.env`.
_NO_TOKENS = {"ZENODO_TOKEN": "", "HF_TOKEN": ""}


@command(
    sandbox_app,
    raw=True,
    without=("json",),
    resumable=False,
    data="ignores",
    examples=[
        ("kb sandbox -- kb youtube crawl --data /tmp/try     run a command against the sandbox"),
        (
            "kb sandbox --env sandbox.env                       write the settings to a file,"
            " serve until SIGTERM"
        ),
        "kb sandbox --channels 50 --videos 5000             a larger world",
        "kb sandbox --profile gardening -- kb youtube crawl     a world made from a profile",
        "kb sandbox --films films -- kb youtube crawl       with films, to try `kb clips` on",
    ],
)
def sandbox(
    options: Options,
    run: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="[-- COMMAND]",
            help="A command to run with the settings. kb exits with its exit code.",
        ),
    ] = None,
    env: Annotated[
        Path | None,
        typer.Option(
            "--env", metavar="FILE", help="Write the settings to FILE, as NAME=value lines."
        ),
    ] = None,
    seed: Annotated[int, typer.Option("--seed", help="Seed of the world.")] = 0,
    channels: Annotated[
        int, typer.Option("--channels", min=1, help="Number of YouTube channels.")
    ] = 12,
    videos: Annotated[int, typer.Option("--videos", min=0, help="Number of YouTube videos.")] = 300,
    truth: Annotated[
        Path | None,
        typer.Option(
            "--truth",
            metavar="FILE",
            help="Write what is planted in the videos to FILE (JSON): misheard keywords, shifted"
            " tracks, copies, recurring texts, other languages.",
        ),
    ] = None,
    films: Annotated[
        Path | None,
        typer.Option(
            "--films",
            metavar="DIR",
            help="Write a film for each video to DIR (ID.mp4, 12 s for 300 videos), in which a"
            " coloured shape stands for each keyword that is spoken.",
        ),
    ] = None,
    model: Annotated[
        bool,
        typer.Option("--model/--no-model", help="Make the tiny toxicity model unless it exists."),
    ] = True,
) -> None:
    """Serve YouTube, wiki and Reddit of a small invented world on loopback.

    The world is made from the profile: its keywords, labels, categories, subreddit and thresholds.
    Without COMMAND, prints the settings as NAME=value lines, closes stdout, and serves until
    SIGTERM. COMMAND gets neither ZENODO_TOKEN nor HF_TOKEN, so that it can't publish what is
    invented.
    """
    from kb.sandbox.server import Sandbox
    from kb.sandbox.wiki.generated import PAGES
    from kb.sandbox.world import World

    domain = _domain(options)
    world = World(seed, n_channels=channels, n_videos=videos, n_named=PAGES, domain=domain)
    if truth is not None:
        _write(truth, json.dumps(world.truth, indent=1) + "\n")
    if films is not None:
        from kb.sandbox.youtube.films import write_films

        write_films(world, films.expanduser().absolute())
    with Sandbox(world) as services:
        given = {
            "KB_DATA": options.data and str(options.data.absolute()),
            "KB_PROFILE": options.profile,
        }
        if options.profile and Path(options.profile).is_file():  # COMMAND may run anywhere
            given["KB_PROFILE"] = str(Path(options.profile).absolute())
        settings = services.settings()
        if model:
            settings |= _tiny_model(lambda why: fail(f"no KB_TOXICITY_MODEL: {why}"))
        settings |= {name: value for name, value in given.items() if value}
        if env is not None:  # for readers of `.env` and for `set -a; . FILE`
            _write(env, "".join(f"{k}={shlex.quote(v)}\n" for k, v in settings.items()))
        if run:
            raise typer.Exit(_run(run, settings | _NO_TOKENS))
        if env is None:
            print("\n".join(f"{name}={value}" for name, value in settings.items()), flush=True)
        _close_stdout()
        # SIGTERM and SIGINT raise KeyboardInterrupt in the main thread, which waits here.
        try:
            while True:  # in steps, as a signal just before a wait is noticed only after it
                time.sleep(1)
        except KeyboardInterrupt:
            raise typer.Exit(0) from None


def _domain(options: Options) -> Domain:
    """The world's domain. Raises ProfileError for a profile that commands would refuse."""
    from kb.cli.commands.profile_files import refuse
    from kb.core.config.profile import DEFAULT, load_profile
    from kb.core.config.settings import load_settings
    from kb.sandbox.domain import domain_of

    profile = load_profile(load_settings(kb_profile=options.profile).kb_profile or DEFAULT)
    refuse(profile)
    return domain_of(profile)


def _write(path: Path, text: str) -> None:
    """Write a file atomically."""
    from kb.store.atomic import write_text

    write_text(path.expanduser().absolute(), text)


def _run(words: list[str], settings: dict[str, str]) -> int:
    """Run the command, and pass signals on to it. Returns its exit code as a shell does."""
    # `kb` means this kb, even if its environment is not activated.
    path = os.pathsep.join([str(Path(sys.executable).parent), os.environ.get("PATH", os.defpath)])
    command = shutil.which(words[0], path=path)
    if command is None:
        raise SettingError(f"{words[0]}: no such command")
    child = subprocess.Popen([command, *words[1:]], env=os.environ | settings | {"PATH": path})

    def pass_on(number: int, frame: object) -> None:
        # A terminal sends Ctrl-C to the child itself; a second one would end it in mid-item.
        if number != signal.SIGINT or not sys.stdin.isatty():
            child.send_signal(number)

    with signals.handling(pass_on):
        code = child.wait()
    return code if code >= 0 else 128 - code


def _close_stdout() -> None:
    """Close stdout, so that a reader of the settings sees their end."""
    sys.stdout.flush()
    null = os.open(os.devnull, os.O_WRONLY)
    os.dup2(null, sys.stdout.fileno())
    os.close(null)
