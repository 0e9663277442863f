"""The command tree of `kb`. A command's module is imported only when the command is named."""

import functools
import importlib
from collections.abc import Iterator, Sequence
from types import ModuleType
from typing import Annotated, Any

import typer
import typer.core
import typer.main

from kb import __version__
from kb.cli.framework.usage_errors import refuse_unknown
from kb.core.sources import SOURCES

DEFAULT = "kb.cli.framework.source_commands"  # of sources without commands of their own

_COMMANDS = "kb.cli.commands."
_OWN = {name: f"{_COMMANDS}sources.{name}" for name in ("youtube", "wiki", "reddit")}
# name -> (module, one line for `kb --help`). The module has a typer app of one or several commands,
# `app` unless another name follows a colon.
TREE = {
    **{name: (_OWN.get(name, DEFAULT), source.help) for name, source in SOURCES.items()},
    **{
        name: (_COMMANDS + module, line)
        for name, module, line in (
            (
                "restore",
                "restore",
                "Restore the content of a downloaded release with your own keys.",
            ),
            ("models", "toxicity:models_app", "Download the toxicity model."),
            ("annotate", "toxicity:annotate_app", "Score text for toxicity."),
            ("pairs", "pairs", "Make keyword-matched video-text pairs."),
            ("tasks", "tasks", "Mine candidates for creative tasks from titles of videos."),
            ("clips", "clips", "Cut the clips of pairs out of your own video files."),
            ("label", "label", "Let people judge a sample in Label Studio."),
            ("links", "links", "Find which videos, wiki pages and threads mention which entities."),
            ("release", "release", "Check, describe and publish release/."),
            ("report", "report", "Make figures and one HTML page about the collected data."),
            ("status", "status.command", "Show progress, quota, age of the data and what is left."),
            ("verify", "verify", "Find damaged, missing and foreign files; repair them."),
            ("profile", "profile.command", "Make and check the profile of a new domain."),
            ("index", "search:index_app", "Build the local search index."),
            ("search", "search:search_app", "Search transcripts, wiki pages and threads."),
            (
                "mcp",
                "search:mcp_app",
                "Serve search and tables to agents (Model Context Protocol).",
            ),
            ("query", "query", "Run SQL over the tables with DuckDB."),
            (
                "explore",
                "explore",
                "Look at rows, stages and pairs in a browser, on this machine.",
            ),
            (
                "refresh",
                "sources.refresh",
                "Re-read data that the services' terms require fresh.",
            ),
            (
                "purge",
                "sources.purge",
                "Remove content that was deleted at its source or is named.",
            ),
            ("sandbox", "sandbox", "Serve invented YouTube, wiki and Reddit on this machine."),
            ("demo", "demo", "Run the whole job on the sandbox in minutes: no key, no network."),
        )
    },
}
CONTEXT: dict[str, Any] = {"help_option_names": ["--help", "-h"]}  # groups inherit it


def command_module(name: str) -> ModuleType:
    """The module that declares a name in TREE."""
    return importlib.import_module(TREE[name][0].partition(":")[0])


@functools.cache
def _loaded(name: str) -> Any:
    """The click command of a name in TREE. Imports its module."""
    module = command_module(name)
    attribute = TREE[name][0].partition(":")[2] or "app"
    app = module.app_of(name) if module.__name__ == DEFAULT else getattr(module, attribute)
    command = typer.main.get_command(app)
    command.name = name
    return command


def leaves() -> Iterator[tuple[str, Any]]:
    """("youtube crawl", its click command) of every command that can be run, in order."""
    for name in TREE:
        yield from _leaves_of(name)


def _leaves_of(name: str) -> Iterator[tuple[str, Any]]:
    command = _loaded(name)
    inner = getattr(command, "commands", {})
    if not inner or command.invoke_without_command:
        yield name, command
    for child, leaf in inner.items():
        yield f"{name} {child}", leaf


def find_command(words: Sequence[str]) -> Any | None:
    """The click command that a line (without its `kb`) begins with; None where there is none."""
    if not words or words[0] not in TREE:
        return None
    known = dict(_leaves_of(words[0]))
    return known.get(" ".join(words[:2])) or known.get(words[0])


def context(path: str, command: Any) -> Any:
    """What click needs to show the help of `kb PATH` as `kb` itself shows it."""
    return typer.Context(command, info_name=f"kb {path}", **CONTEXT)


class Tree(typer.core.TyperGroup):
    """The root group: lists all commands, and loads only the one that is named."""

    leaves = staticmethod(leaves)

    def __init__(self, **attrs: Any) -> None:
        super().__init__(**attrs)
        self.commands = dict.fromkeys(TREE)  # type: ignore[assignment]  # names only; see get_command

    def get_command(self, ctx: Any, cmd_name: str) -> Any:
        """The click command, or None for an unknown name."""
        return _loaded(cmd_name) if cmd_name in TREE else None

    def parse_args(self, ctx: Any, args: list[str]) -> Any:
        """`kb help COMMAND` is `kb COMMAND --help`."""
        if args[:1] == ["help"]:
            args = [*args[1:], "--help"]
        return super().parse_args(ctx, args)

    def resolve_command(self, ctx: Any, args: list[str]) -> Any:
        """The named command. Raises a usage error with suggestions for an unknown one."""
        refuse_unknown(self, ctx, args)
        return super().resolve_command(ctx, args)

    def format_commands(self, ctx: Any, formatter: Any) -> None:
        """The list of `kb --help`, without importing what it lists."""
        with formatter.section("Commands"):
            formatter.write_dl([(name, line) for name, (_, line) in TREE.items()])

    def format_epilog(self, ctx: Any, formatter: Any) -> None:
        """Where to start."""
        formatter.write(
            "\nStart here:\n  kb demo                      the whole job on invented services\n"
            "  kb youtube crawl --plan      what a real crawl would cost\n"
            "  kb help COMMAND              options and examples of a command\n"
            "  kb --install-completion      complete commands and options with the Tab key\n"
        )


def _version(wanted: bool) -> None:
    if wanted:
        print(f"kb {__version__}")
        raise typer.Exit


# Help is plain text: it is read in pipes and on small terminals, and needs no rich to be imported.
app = typer.Typer(
    name="kb",
    cls=Tree,
    no_args_is_help=True,
    context_settings=CONTEXT,
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
)


@app.callback()
def root(
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Print the version.")
    ] = False,
) -> None:
    """Build an open knowledge base about a domain from YouTube, a wiki and Reddit."""
