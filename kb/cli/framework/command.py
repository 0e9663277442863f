"""Declares commands. Common options, signals, log, progress, summary and exit code come with it.

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

The first parameter is the Run (or, with `raw=True`, the Options as given). The return value is
printed as the command's summary; None prints nothing. A `KbError` may carry the summary so far in
`.summary`.
"""

import contextlib
import inspect
import os
import signal
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any, get_type_hints

import typer

from kb.cli.framework import messages
from kb.cli.framework.command_classes import Command, Group
from kb.cli.framework.exit_codes import report
from kb.cli.framework.options import COMMON, RUNNING, SHARED, Options, shared_option
from kb.cli.framework.usage_errors import UsageProblem
from kb.core import signals, startup
from kb.core.errors import SettingError
from kb.core.installation import cache_root

# Types in signatures whose modules are imported only when a command runs.
_LATE = {"Run": object, "Summary": object, "Options": Options}


def group(about: str) -> typer.Typer:
    """An app for a module of kb.cli.commands: a group of commands, or a single one."""
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

    `uses`: which options of RUNNING affect it; `limit` and `again` are their help texts and imply
    the option. `json`: what its summary holds. `without`: options of COMMON that it lacks. Options
    that are not declared are refused (exit code 2).
    `raw`: pass Options instead of a Run.
    `resumable`: after a signal it finishes the current item; other commands end at once (queries,
    servers).
    `main`: it runs when the group is called without a command.
    `needs_data`: a data root that does not exist is an error (exit code 2) that names the nearest
    one.
    `cls`: how it parses its arguments.
    `planned`: options, own ones included, that affect its `--plan`.
    `checks`: an error in the profile or its keyword lists ends the command (exit code 2) before
    anything is sent.
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
        call = partial(
            _call,
            function,
            raw=raw,
            resumable=resumable,
            needs_data=needs_data,
            needs="profile" if "data" in shared else "nothing",
            planned=planned,
            checks=checks,
        )
        wrapped = _wrap(function, shared, call, main=main)
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
    call: Callable[[Options, dict[str, Any]], int],
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
            _refuse_group_options(context)
            return 0
        options = Options(**{name: values.pop(name) for name in shared})
        return call(options, values)

    run.__doc__ = function.__doc__
    run.__name__ = function.__name__
    run.__signature__ = signature.replace(parameters=parameters, return_annotation=int)  # type: ignore[attr-defined]
    run.__annotations__ = {parameter.name: parameter.annotation for parameter in parameters}
    return run


def _call(
    function: Callable[..., Any],
    options: Options,
    values: dict[str, Any],
    *,
    raw: bool = False,
    resumable: bool = True,
    needs_data: bool = False,
    needs: str = "profile",
    planned: Sequence[str] = (),
    checks: bool = False,
) -> int:
    startup.collect_seldom()  # before the imports
    from kb.cli.framework import logs

    messages.set_options(options.data, options.profile)
    try:
        with _signals(resumable):
            logs.configure(quiet=options.quiet, debug=options.debug)
            if values.get("plan"):
                _check_plan_options(function, options, values, planned)
            first: Any = options
            if not raw:
                first = options.make_run(needs=needs, checks=checks, exists=needs_data)
            try:
                summary = function(first, **values)
            finally:
                if not raw:
                    first.progress.close()  # the terminal, before anything else is printed
            if summary is not None:
                messages.show_summary(summary, options.json)
    except typer.Exit as done:
        return done.exit_code
    except (Exception, KeyboardInterrupt) as error:  # noqa: BLE001  the one place where everything ends
        return report(
            error, debug=options.debug, as_json=options.json, places=_written(options.data)
        )
    finally:
        messages.set_options()  # for the next call in this process
    return 0


def _written(data: Path | None) -> tuple[Path, ...]:
    """Where any command may write: the data root, the cache, the temporary folder, and stdout, if
    that is a file.
    """
    root = data or Path(os.environ.get("KB_DATA") or "data")
    stdout = Path("/dev/stdout").resolve()
    return root.expanduser(), cache_root(), Path(tempfile.gettempdir()), stdout


def _check_plan_options(
    function: Callable[..., Any],
    options: Options,
    values: Mapping[str, Any],
    planned: Sequence[str],
) -> None:
    """Raise SettingError for an option that has no effect on `--plan`.

    `values` are those of the command's own options, whose defaults `function` knows; `planned`
    names the options, own and shared ones, that change the plan.
    """
    given = [name for name in RUNNING if getattr(options, name) != getattr(Options, name)]
    declared = inspect.signature(function).parameters
    given += [name for name in values if name != "plan" and values[name] != declared[name].default]
    unused = [f"--{name.replace('_', '-')}" for name in given if name not in planned]
    if unused:
        names = " and ".join(unused)
        raise SettingError(
            f"{names} {'has' if len(unused) == 1 else 'have'} no effect on --plan",
            hint=f"--plan always covers all remaining work; drop {names}",
        )


@contextlib.contextmanager
def _signals(resumable: bool) -> Iterator[None]:
    """A resumable command finishes the current item; SIGINT and SIGTERM end any other at once."""
    if resumable:
        with signals.stop_on_signals():
            yield
        return
    heeded = [one for one in signals.BOTH if signal.getsignal(one) is not signal.SIG_IGN]
    with signals.handling(signal.default_int_handler, heeded):
        yield


def _refuse_group_options(context: Any) -> None:
    """Raise a usage error for an option of the group that is given before one of its commands."""
    for parameter in context.command.params:
        source = context.get_parameter_source(parameter.name)
        if source is not None and source.name == "COMMANDLINE":
            name, option = context.invoked_subcommand, parameter.opts[0]
            raise UsageProblem(
                f"put {option} after `{name}`: `{context.command_path} {name} {option} …`", context
            )
