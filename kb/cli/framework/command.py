"""The one way to declare a command: common options, signals, log, progress, summary and exit code
come with it.

    app = group("Channels, videos and transcripts.")

    @command(
        app,
        uses=("wait",),
        limit="Stop after N videos (exit code 3); the next run resumes.",
        json="crawled, failed, pending, requests",
        examples=["kb youtube crawl --limit 100"],
    )
    def crawl(run: Run, only: Annotated[Phase | None, typer.Option(help="…")] = None) -> Summary:
        '''First line: the short help. The rest: the long one.'''
        from kb.youtube.connector.source import crawl      # heavy things inside
        return crawl(run, only=only)

The first parameter is the Run (or, with `raw=True`, the Options as given). What the function
returns is printed as its summary; None prints nothing. A `KbError` may carry its summary so far as
`.summary`.
"""

from __future__ import annotations

import contextlib
import inspect
import signal
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, get_type_hints

import typer

from kb.cli.framework import outcome
from kb.cli.framework.help import Command, Group
from kb.cli.framework.misplaced import UsageProblem
from kb.cli.framework.options import COMMON, SHARED, Options, shared_option

# Types that signatures name and that are imported once a command runs.
_LATE = {"Run": object, "Summary": object, "Options": Options}


@dataclass(frozen=True)
class Nature:
    """How a command is called, as `command` was told."""

    raw: bool = False
    resumable: bool = True
    needs_data: bool = False
    needs: str = "profile"
    planned: tuple[str, ...] = ()
    checks: bool = False


def group(about: str) -> typer.Typer:
    """An app for a file of kb/cli: a group of commands, or the holder of a single one."""
    return typer.Typer(
        help=about,
        cls=Group,
        add_completion=False,
        rich_markup_mode=None,
        pretty_exceptions_enable=False,
    )


def command(
    app: typer.Typer,
    name: str | None = None,
    *,
    examples: Sequence[str],
    uses: Sequence[str] = (),
    limit: str = "",
    again: str = "",
    json: str = "",
    without: Sequence[str] = (),
    raw: bool = False,
    resumable: bool = True,
    main: bool = False,
    needs_data: bool = False,
    cls: type[Command] = Command,
    planned: Sequence[str] = (),
    checks: bool = False,
) -> Callable[[Callable[..., Any]], Callable[..., Any]]:
    """Declare a command of `app`.

    `uses`: those of the options in RUNNING that have an effect on it; `limit` and `again` count as
    used where they are given, as what --limit and --again do for this command. `json`: what its
    summary holds. `without`: those of COMMON that have none. What is not declared is refused
    (exit 2).
    `raw`: pass Options instead of a Run.
    `resumable`: a signal lets the item in hand be finished; otherwise it ends the command at once
    (queries, servers).
    `main`: what the group itself does when none of its commands is named.
    `needs_data`: it works on what was collected, so a data root that does not exist is an error
    (exit 2) that names the nearest one.
    `cls`: how it reads its arguments.
    `planned`: the options, own ones included, that change what its `--plan` says.
    `checks`: the profile and its keyword lists are looked through first, and an error there ends
    the command (exit 2) before anything is sent.
    """

    def declare(function: Callable[..., Any]) -> Callable[..., Any]:
        about = {
            "limit": limit,
            "again": again,
            "json": json and f"Print the summary as JSON, the last line on stdout: {json}.",
        }
        used = {*uses, *(name for name in ("limit", "again") if about[name])}
        shared = {
            name: shared_option(name, about.get(name))
            for name in SHARED
            if name in used or (name in COMMON and name not in without)
        }
        nature = Nature(
            raw=raw,
            resumable=resumable,
            needs_data=needs_data,
            needs="profile" if "data" in shared else "nothing",
            planned=tuple(planned),
            checks=checks,
        )
        wrapped = _wrap(function, shared, nature, main=main)
        epilog = "\n".join(examples)
        if main:
            app.callback(invoke_without_command=True, cls=Group, epilog=epilog)(wrapped)
        else:
            app.command(name, cls=cls, epilog=epilog)(wrapped)
        return function

    return declare


def _wrap(
    function: Callable[..., Any],
    shared: Mapping[str, inspect.Parameter],
    nature: Nature,
    *,
    main: bool,
) -> Callable[..., Any]:
    signature = inspect.signature(function)
    _, *own = signature.parameters.values()
    hints = get_type_hints(function, localns=_LATE, include_extras=True)
    parameters = [
        parameter.replace(kind=inspect.Parameter.KEYWORD_ONLY, annotation=hints[parameter.name])
        for parameter in own
    ]
    parameters += shared.values()
    if main:
        parameters.append(
            inspect.Parameter("context", inspect.Parameter.KEYWORD_ONLY, annotation=typer.Context)
        )

    def run(**values: Any) -> int:
        context = values.pop("context", None)
        if context is not None and context.invoked_subcommand is not None:
            _nothing_before(context)
            return 0
        options = Options(**{name: values.pop(name) for name in shared})
        return _call(function, options, values, nature)

    run.__doc__ = function.__doc__
    run.__name__ = function.__name__
    run.__signature__ = signature.replace(parameters=parameters, return_annotation=int)  # type: ignore[attr-defined]
    run.__annotations__ = {parameter.name: parameter.annotation for parameter in parameters}
    return run


def _call(
    function: Callable[..., Any],
    options: Options,
    values: dict[str, Any],
    nature: Nature,
) -> int:
    from kb.core import garbage

    garbage.seldom()  # before the imports
    from kb.cli.framework import as_typed, logs, planned

    as_typed.begin(options.data, options.profile)
    try:
        with _signals(nature.resumable):
            logs.configure(quiet=options.quiet, debug=options.debug)
            planned.check(function, options, values, nature.planned)
            first: Any = options
            if not nature.raw:
                first = options.make_run(
                    needs=nature.needs, checks=nature.checks, exists=nature.needs_data
                )
            try:
                summary = function(first, **values)
            finally:
                if not nature.raw:
                    first.progress.close()  # the terminal, before anything else is printed
            if summary is not None:
                outcome.show_summary(summary, options.json)
    except typer.Exit as done:
        return done.exit_code
    except (Exception, KeyboardInterrupt) as error:  # noqa: BLE001  the one place where everything ends
        return outcome.ending(error, debug=options.debug, as_json=options.json)
    finally:
        as_typed.begin()  # a next call in this process was not typed with these
    return 0


@contextlib.contextmanager
def _signals(resumable: bool) -> Iterator[None]:
    if resumable:
        from kb.core.signals import stop_on_signals

        with stop_on_signals():
            yield
        return
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    numbers = [
        number
        for number in (signal.SIGINT, signal.SIGTERM)
        if signal.getsignal(number) is not signal.SIG_IGN
    ]
    before = {number: signal.signal(number, signal.default_int_handler) for number in numbers}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def _nothing_before(context: Any) -> None:
    """Refuse an option of the group itself before a command, which would not hear of it."""
    for parameter in context.command.params:
        source = context.get_parameter_source(parameter.name)
        if source is not None and source.name == "COMMANDLINE":
            name = context.invoked_subcommand
            raise UsageProblem(
                f"{parameter.opts[0]} stands before `{name}`, which would not hear of it:"
                f" write `{context.command_path} {name} {parameter.opts[0]} …`",
                context,
            )
