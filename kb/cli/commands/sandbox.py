"""`kb sandbox`: serve the invented services for a command or until SIGTERM."""

from __future__ import annotations

import json
import os
import shlex
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from kb.cli.framework.command import command, group
from kb.cli.framework.messages import fail
from kb.cli.framework.options import Options
from kb.core import signals
from kb.core.errors import KbError, SettingError

if TYPE_CHECKING:
    from kb.sandbox.domain import Domain

app = group("Serve invented YouTube, wiki, Reddit, Zenodo and Hugging Face hub on this machine.")


@command(
    app,
    raw=True,
    without=("json",),
    resumable=False,
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
    """Serve YouTube, wiki, Reddit, Zenodo and hub of a small invented world on loopback.

    The world is made from the profile: its keywords, labels, categories, subreddit and thresholds.
    Without COMMAND, prints the settings as NAME=value lines, closes stdout, and serves until
    SIGTERM.
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
            "KB_PROFILE": options.profile and _anywhere(options.profile),
        }
        settings = services.settings() | _model(wanted=model)
        settings |= {name: value for name, value in given.items() if value}
        if env is not None:  # for readers of `.env` and for `set -a; . FILE`
            _write(env, "".join(f"{k}={shlex.quote(v)}\n" for k, v in settings.items()))
        if run:
            raise typer.Exit(_run(run, settings))
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
    from kb.cli.commands.profile.check import refuse
    from kb.core.config.profile import DEFAULT, load_profile
    from kb.core.config.settings import load_settings
    from kb.sandbox.domain import domain_of

    profile = load_profile(load_settings(kb_profile=options.profile).kb_profile or DEFAULT)
    refuse(profile)
    return domain_of(profile)


def _model(*, wanted: bool) -> dict[str, str]:
    """The tiny model's setting; none, with a line on stderr, where its extra is missing."""
    if not wanted:
        return {}
    from kb.sandbox import toxicity

    try:
        return toxicity.settings()
    except KbError as error:
        fail(f"no KB_TOXICITY_MODEL: {error}", hint=error.hint)
        return {}


def _anywhere(profile: str) -> str:
    """A profile's name, or the absolute path of its file."""
    path = Path(profile)
    return str(path.absolute()) if path.is_file() else profile


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
