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
        from kb.youtube.crawl.connector import crawl      # heavy things inside
        return crawl(run, only=only)

The first parameter is the Run (or, with `raw=True`, the Options as given), the others are the
command's own options. The return value is printed as the command's summary; None prints nothing. A
`KbError` may carry the summary so far in `.summary`.
"""

import contextlib
import inspect
import logging
import os
import signal
import sys
import tempfile
import warnings
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from types import MethodType
from typing import Any, TypeVar

import typer
import typer.core
import typer.main

from kb.cli.framework import messages
from kb.cli.framework.exit_codes import refuse_options_before_command, refuse_unknown, report
from kb.cli.framework.options import (
    COMMON,
    DUMPS,
    RUNNING,
    RUNS,
    SHARED,
    WRITTEN,
    DataUse,
    Options,
    data_folder,
    shared_option,
)
from kb.cli.framework.run_trace import OWN, log_end, logging_of, record_run
from kb.core import clock, signals, terminal
from kb.core.errors import SettingError, UsageError
from kb.core.installation import cache_root
from kb.core.progress import EVENTS
from kb.net import redact
from kb.version import __version__

_names: list[str] = []  # of the command that runs


class _Sections:
    """For a command, and for a group that is a command as well (`kb pairs`, `kb release`)."""

    def invoke(self: Any, ctx: Any) -> Any:
        """Run it; its name stands in the log and in the record of its run."""
        _names[:] = [ctx.command_path.removeprefix("kb ")]
        return super().invoke(ctx)  # type: ignore[misc]

    def format_options(self: Any, ctx: Any, formatter: Any) -> None:
        """Arguments, own options, how to run it, common options."""
        titles = "Arguments", "Options", "Run options", "Common options"
        sections: dict[str, list[tuple[str, str]]] = {title: [] for title in titles}
        for parameter in self.get_params(ctx):
            record = parameter.get_help_record(ctx)
            if record is not None:
                sections[_section(parameter)].append(record)
        for title, records in sections.items():
            if records:
                with formatter.section(title):
                    formatter.write_dl(records)

    def format_epilog(self: Any, ctx: Any, formatter: Any) -> None:
        """Examples, line by line as written."""
        if self.epilog:
            lines = "".join(f"  {line}\n" for line in self.epilog.splitlines())
            formatter.write(f"\nExamples:\n{lines}")


class Command(_Sections, typer.core.TyperCommand):
    """A command; `function` does its work, and takes a Run first."""

    function: Callable[..., Any]


class Group(_Sections, typer.core.TyperGroup):
    """A group of commands, which may be a command itself (`run_as`)."""

    def run_as(self, command: Any) -> None:
        """Do what `command` does when none of the group's commands is named."""
        self.function, self.params, self.epilog = command.function, command.params, command.epilog
        self.data_use = command.data_use
        self.callback = lambda **values: command.callback(**values) if values else 0
        self.invoke_without_command = True

    def resolve_command(self, ctx: Any, args: list[str]) -> Any:
        """The named command. Raises a usage error with suggestions for an unknown one, and for an
        option of the group itself.
        """
        refuse_unknown(self, ctx, args)
        refuse_options_before_command(ctx, args[0])
        ctx.params.clear()  # the group itself does nothing
        return super().resolve_command(ctx, args)

    def format_options(self, ctx: Any, formatter: Any) -> None:
        """The group's commands, then its options."""
        self.format_commands(ctx, formatter)
        super().format_options(ctx, formatter)


def _section(parameter: Any) -> str:
    if parameter.param_type_name == "argument":
        return "Arguments"
    if parameter.name in RUNNING:
        return "Run options"
    return "Common options" if parameter.name in (*COMMON, "help") else "Options"


class DumpsCommand(Command):
    """Takes every word after --dumps, up to the next option, as one of its files.

    Where the command itself takes folders, only a folder right after --dumps belongs to it.
    """

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Parse the arguments with --dumps repeated before each file."""
        takes_folders = any(param.param_type_name == "argument" for param in self.params)
        words: list[str] = []
        inside = False
        for word, before in zip(args, ["", *args], strict=False):
            if word.startswith("-"):
                inside = word == DUMPS
            elif inside and before != DUMPS:
                if takes_folders and Path(word).is_dir():
                    inside = False
                else:
                    words.append(DUMPS)
            words.append(word)
        return super().parse_args(ctx, words)


Function = TypeVar("Function", bound=Callable[..., Any])


def group(about: str) -> Group:
    """What a module of kb.cli.commands declares: a group of commands, or a single one."""
    return Group(help=about, rich_markup_mode=None)


def command(
    app: Group,
    name: str | None = None,
    *,
    examples: Sequence[str],
    help: str | None = None,
    uses: Sequence[str] = (),
    limit: str = "",
    again: str = "",
    json: str = "",
    without: Sequence[str] = (),
    raw: bool = False,
    resumable: bool = True,
    main: bool = False,
    data: DataUse = "writes",
    cls: type[Command] = Command,
    planned: Sequence[str] = (),
    checks: bool = False,
    records: bool | None = None,
) -> Callable[[Function], Function]:
    """Declare a command of `app`.

    `help`: instead of the function's docstring. `uses`: which options of RUNNING affect it; `limit`
    and `again` are their help texts and imply the option. `json`: what its summary holds.
    `without`: options of COMMON that it lacks. Options that are not declared are refused (exit
    code 2).
    `raw`: pass Options instead of a Run.
    `resumable`: after a signal it finishes the current item; other commands end at once (queries,
    servers).
    `main`: it runs when the group is called without a command.
    `data`: what it does with the data root. A command that writes refuses a download (exit code 2),
    and all but those that make a data root refuse one that does not exist. No command writes into a
    download by one of the options WRITTEN.
    `cls`: how it parses its arguments.
    `planned`: options, own ones included, that affect its `--plan`.
    `checks`: an error in the profile or its keyword lists ends the command (exit code 2) before
    anything is sent.
    `records`: a run leaves a record in state/runs; by default, that of a command that writes.
    """
    recorded = data in ("writes", "makes") if records is None else records

    def declare(function: Function) -> Function:
        own = typer.Typer(rich_markup_mode=None, add_completion=False)
        bound = MethodType(function, app)  # like a method, whose first parameter is no option
        own.command(name, cls=cls, help=help, epilog="\n".join(examples))(bound)
        made: Any = typer.main.get_command(own)
        about = {
            "limit": limit,
            "again": again,
            "json": json and f"Print the summary as JSON, the last line on stdout: {json}.",
        }
        used = {*uses, *(name for name in ("limit", "again") if about[name])}
        made.params += [
            shared_option(name, about.get(name))
            for name in SHARED
            if name in used or (name in COMMON and name not in without)
        ]
        made.function, made.data_use = function, data
        made.callback = partial(_call, function, raw, resumable, data, planned, checks, recorded)
        if main:
            app.run_as(made)
        else:
            app.add_command(made)
        return function

    return declare


def _call(
    function: Callable[..., Any],
    raw: bool,
    resumable: bool,
    use: DataUse,
    planned: Sequence[str],
    checks: bool,
    records: bool,
    /,
    **values: Any,
) -> int:
    """Run a command with the values of its own and the shared options; return the exit code. Its
    events go to the log, and its run leaves a record.
    """
    needs = "profile" if "profile" in values else "nothing"
    shared = {name: values.pop(name) for name in SHARED if name in values}
    options = Options(**shared, use=use)
    for name, value in values.items():  # what may be repeated; what is not given, is None
        if isinstance(value, (list, tuple)):
            values[name] = list(value) or None
    messages.set_options(options.data, options.profile, data_folder(options.data))
    RUNS.clear()
    name, start, began = _names[-1], clock.now(), clock.monotonic()
    try:
        configure_logs(debug=options.debug)
        with logging_of(options, name) as logged:
            EVENTS.info("begins, version %s", __version__, extra=OWN)
            answer = partial(_answer, function, raw, resumable, planned, checks, needs)
            code, summary = answer(options, values)
            seconds = clock.monotonic() - began
            if logged:
                log_end(code, seconds, summary)
            records = records or bool(values.get("repair"))
            if records and code != UsageError.exit_code and not values.get("plan"):
                record_run(name, start, seconds, code, summary)
    finally:
        messages.set_options()  # for the next call in this process
    return code


def _answer(
    function: Callable[..., Any],
    raw: bool,
    resumable: bool,
    planned: Sequence[str],
    checks: bool,
    needs: str,
    options: Options,
    values: dict[str, Any],
) -> tuple[int, Mapping[str, Any]]:
    """The exit code of a command, and its summary, which is printed."""
    summary: Any = None
    try:
        with _signals(resumable):
            if values.get("plan"):
                _check_plan_options(function, options, values, planned)
            else:
                _check_places(options, values)
            if raw:
                summary = function(options, **values)
            else:
                run = options.make_run(needs=needs, checks=checks)
                try:
                    summary = function(run, **values)
                finally:
                    run.progress.close()  # the terminal, before anything else is printed
            if summary is not None:
                messages.show_summary(summary, options.json)
    except typer.Exit as done:
        return done.exit_code, summary or {}
    except (Exception, KeyboardInterrupt, SystemExit) as error:  # noqa: BLE001  all ends here
        code = report(
            error, debug=options.debug, as_json=options.json, places=_written(options.data)
        )
        waits_for = getattr(error, "waits_for", "")
        return code, {**(getattr(error, "summary", None) or {}), "waits_for": waits_for}
    return 0, summary if isinstance(summary, Mapping) else {}


def _check_places(options: Options, values: Mapping[str, Any]) -> None:
    """Raise UsageError for a place to write to that lies in a download, also in the one that is
    read.
    """
    for name in WRITTEN:
        if values.get(name) is not None:
            from kb.artifacts.table_catalog import Catalog, outside, refuse_download

            refuse_download(values[name], f"--{name}")
            root = data_folder(options.data).absolute()
            if Catalog(root).is_download:
                outside(root, values[name])


def _written(data: Path | None) -> tuple[Path, ...]:
    """Where any command may write: the data root, the cache, the temporary folder, and stdout, if
    that is a file.
    """
    stdout = Path("/dev/stdout").resolve()
    return data_folder(data), cache_root(), Path(tempfile.gettempdir()), stdout


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
    heeded = [sent for sent in signals.BOTH if signal.getsignal(sent) is not signal.SIG_IGN]
    with signals.handling(signal.default_int_handler, heeded):
        yield


# What to do about the lines of libraries that serve, by the beginning of their names.
_ADVICE = {
    "uvicorn": "the pages go on; reload the one that failed, and run `kb verify` if it fails again",
    "mcp": "the server goes on; `kb mcp --debug` shows what the client sent",
}


class Handler(logging.Handler):
    """Prints log records, those of libraries (praw, urllib3, selenium …) as well, on stderr. Of a
    line that is repeated, the second says so, and the others are in the log alone.
    """

    def __init__(self, *, debug: bool = False) -> None:
        super().__init__()
        self._debug = debug
        self._counts: Counter[str] = Counter()

    def emit(self, record: logging.LogRecord) -> None:
        """One redacted line; never raises."""
        try:
            message, _, trace = self.format(record).partition("\nTraceback ")
            line = f"{record.levelname.lower()}: {record.name}: {message}"
            text = terminal.one_line(redact.text(line))
            self._counts[text] += 1
            if not self._debug and (count := self._counts[text]) > 1:
                if count == 2:
                    repeated = "the same again; further ones are only in the log (--log FILE)"
                    print(f"{text[:120]}: {repeated}", file=sys.stderr, flush=True)
                return
            text += f"; {advice}" if (advice := _ADVICE.get(record.name.partition(".")[0])) else ""
            if trace:  # indented, so that its lines can't be taken for lines of ours
                within = redact.text(f"Traceback {trace}").splitlines()
                text += "\n" + terminal.lines("\n".join(f"  {words}" for words in within))
            print(text, file=sys.stderr, flush=True)
        except Exception:  # noqa: BLE001  a log line must not end a crawl
            self.handleError(record)


def configure_logs(*, debug: bool) -> None:
    """Set the level: everything with --debug, otherwise warnings."""
    if not debug:
        # Deprecations inside libraries tell users nothing; worker processes read the variable.
        warnings.simplefilter("ignore")
        os.environ.setdefault("PYTHONWARNINGS", "ignore")
    root = logging.getLogger()
    root.handlers[:] = [Handler(debug=debug)]
    root.setLevel(logging.DEBUG if debug else logging.WARNING)
