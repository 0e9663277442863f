"""`kb sandbox`: the invented services, for a command or until SIGTERM."""

from __future__ import annotations

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

if TYPE_CHECKING:
    from kb.cli.framework.options import Options
    from kb.sandbox.domain import Domain

app = group("Invented services on this machine, to try everything on.")


@command(
    app,
    raw=True,
    without=("json",),
    resumable=False,
    examples=[
        (
            "kb sandbox -- kb youtube crawl --data /tmp/try     a command with the settings"
            " that point at the sandbox"
        ),
        (
            "kb sandbox --env sandbox.env                       write the settings to a file"
            " and serve until SIGTERM"
        ),
        "kb sandbox --channels 50 --videos 5000             a larger world",
        "kb sandbox --profile gardening -- kb youtube crawl     a world made of that profile",
    ],
)
def sandbox(
    options: Options,
    run: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="[-- COMMAND]",
            help="A command to run with the settings; its exit code is kb's.",
        ),
    ] = None,
    env: Annotated[
        Path | None,
        typer.Option(
            "--env", metavar="FILE", help="Write the settings to FILE, as NAME=value lines."
        ),
    ] = None,
    seed: Annotated[int, typer.Option("--seed", help="Which world.")] = 0,
    channels: Annotated[
        int, typer.Option("--channels", min=1, help="YouTube channels of the world.")
    ] = 12,
    videos: Annotated[
        int, typer.Option("--videos", min=0, help="YouTube videos of the world.")
    ] = 300,
    model: Annotated[
        bool,
        typer.Option(
            "--model/--no-model", help="Make the tiny toxicity model, if there is none yet."
        ),
    ] = True,
) -> None:
    """Serve YouTube, wiki, Reddit and Zenodo of one small invented world on loopback.

    The world is made of the profile: its keywords, labels, categories, subreddit and thresholds.
    Without COMMAND the settings are printed as NAME=value lines, stdout is closed, and the services
    run until SIGTERM.
    """
    from kb.sandbox.server import Sandbox
    from kb.sandbox.wiki.generated import PAGES
    from kb.sandbox.world import World

    domain = _domain(options)
    world = World(seed, n_channels=channels, n_videos=videos, n_named=PAGES, domain=domain)
    with Sandbox(world) as services:
        given = {
            "KB_DATA": options.data and str(options.data.absolute()),
            "KB_PROFILE": options.profile and _anywhere(options.profile),
        }
        settings = services.settings() | _model(wanted=model)
        settings |= {name: value for name, value in given.items() if value}
        if env is not None:
            _write(env, settings)
        if run:
            raise typer.Exit(_run(run, settings))
        if env is None:
            print("\n".join(f"{name}={value}" for name, value in settings.items()), flush=True)
        _close_stdout()
        # The default action of SIGTERM and SIGINT is an exception in the main thread, which waits
        # here.
        try:
            while True:  # in steps: a signal just before a wait is heard when it is over
                time.sleep(1)
        except KeyboardInterrupt:
            raise typer.Exit(0) from None


def _domain(options: Options) -> Domain:
    """What the world is about. Raises ProfileError for a profile that commands would refuse."""
    from kb.cli.commands.profile.check import refuse
    from kb.core.profile import DEFAULT, load_profile
    from kb.core.settings import load_settings
    from kb.sandbox.domain import domain_of

    profile = load_profile(load_settings(kb_profile=options.profile).kb_profile or DEFAULT)
    refuse(profile)
    return domain_of(profile)


def _model(*, wanted: bool) -> dict[str, str]:
    """The tiny model's setting; where it can't be made (its extra is missing),
    a word on stderr and none.
    """
    if not wanted:
        return {}
    from kb.cli.framework.outcome import complain
    from kb.core.errors import KbError
    from kb.sandbox import toxicity

    try:
        return toxicity.settings()
    except KbError as error:
        complain(f"no KB_TOXICITY_MODEL: {error}", hint=error.hint)
        return {}


def _anywhere(profile: str) -> str:
    """A profile's file by its whole path, for use in another folder; a name as it is."""
    path = Path(profile)
    return str(path.absolute()) if path.is_file() else profile


def _write(path: Path, settings: dict[str, str]) -> None:
    """A file for `.env` readers and for `set -a; . FILE`. It appears whole."""
    from kb.store.atomic import write_text

    write_text(
        path.expanduser().absolute(),
        "".join(f"{name}={shlex.quote(value)}\n" for name, value in settings.items()),
    )


def _run(words: list[str], settings: dict[str, str]) -> int:
    """Run the command; signals to us are passed on, so that it can finish its item. Its exit code,
    as a shell gives it.
    """
    from kb.core.errors import SettingError

    # `kb` is this kb, also where its environment is not activated.
    path = os.pathsep.join([str(Path(sys.executable).parent), os.environ.get("PATH", os.defpath)])
    command = shutil.which(words[0], path=path)
    if command is None:
        raise SettingError(f"{words[0]}: no such command")
    child = subprocess.Popen([command, *words[1:]], env=os.environ | settings | {"PATH": path})

    def pass_on(number: int, frame: object) -> None:
        # A terminal sends Ctrl-C to the child by itself; twice would end it before its item is
        # finished.
        if number != signal.SIGINT or not sys.stdin.isatty():
            child.send_signal(number)

    before = {number: signal.signal(number, pass_on) for number in (signal.SIGTERM, signal.SIGINT)}
    try:
        code = child.wait()
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
    return code if code >= 0 else 128 - code


def _close_stdout() -> None:
    """Whoever reads our lines through a pipe sees their end."""
    sys.stdout.flush()
    null = os.open(os.devnull, os.O_WRONLY)
    os.dup2(null, sys.stdout.fileno())
    os.close(null)
