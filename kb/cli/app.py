"""The command tree of `kb`. A command's module is imported only when the command is named."""

import functools
from collections.abc import Iterator, Sequence
from typing import Annotated, Any

import typer
import typer.core

from kb.cli.framework import messages
from kb.cli.framework.exit_codes import refuse_unknown
from kb.core.sources import SOURCES
from kb.version import __version__

# name -> one line for `kb --help`
TREE = {
    **{name: source.help for name, source in SOURCES.items()},
    "build": "Make everything that is out of date, in order.",
    "update": "Crawl what is new, refresh, purge and build: for a timer.",
    "restore": "Restore the content of a downloaded release with your own keys.",
    "models": "Download the toxicity model.",
    "annotate": "Score text for toxicity.",
    "pairs": "Make keyword-matched video-text pairs.",
    "tasks": "Mine candidates for creative tasks from titles of videos.",
    "clips": "Cut the clips of pairs out of your own video files.",
    "label": "Let people judge a sample in Label Studio.",
    "links": "Find which videos, wiki pages and threads mention which entities.",
    "release": "Check, describe and publish release/.",
    "report": "Make figures and one HTML page about the collected data.",
    "status": "Show progress, quota, age of the data and what is left.",
    "doctor": "Check what a long crawl needs on this machine.",
    "verify": "Find damaged, missing and foreign files; repair them.",
    "profile": "Make and check the profile of a new domain.",
    "index": "Build the local search index.",
    "search": "Search transcripts, wiki pages and threads.",
    "mcp": "Serve search and tables to agents (Model Context Protocol).",
    "query": "Run SQL over the tables with DuckDB.",
    "diff": "Compare two data roots or releases, row by row.",
    "explore": "Look at rows, stages and pairs in a browser, on this machine.",
    "merge": "Bring the data roots of several machines into one.",
    "refresh": "Re-read data that the services' terms require fresh.",
    "purge": "Remove content that was deleted at its source or is named.",
    "sandbox": "Serve invented YouTube, wiki and Reddit on this machine.",
    "demo": "Run the whole job on the sandbox in minutes: no key, no network.",
}
# What `kb --help`, `make help` and README are grouped by; other commands are among More.
GROUPS = {
    "Collect": tuple(SOURCES),
    "Build": ("build", "annotate", "pairs", "tasks", "links", "index", "clips", "label"),
    "Look": ("status", "query", "diff", "search", "explore", "report", "mcp"),
    "Publish": ("release", "restore"),
    "Maintain": ("update", "refresh", "purge", "verify", "merge", "doctor"),
}
CONTEXT: dict[str, Any] = {"help_option_names": ["--help", "-h"]}  # groups inherit it


@functools.cache
def _loaded(name: str) -> Any:  # noqa: PLR0915  a list of imports
    """The click command of a name in TREE. Imports its module."""
    match name:
        case "youtube":
            from kb.cli.commands.sources import youtube_app as app
        case "wiki":
            from kb.cli.commands.sources import wiki_app as app
        case "reddit":
            from kb.cli.commands.sources import reddit_app as app
        case "build":
            from kb.cli.commands.build import app
        case "update":
            from kb.cli.commands.build import update_app as app
        case "restore":
            from kb.cli.commands.publish import restore_app as app
        case "models":
            from kb.cli.commands.derived import models_app as app
        case "annotate":
            from kb.cli.commands.derived import annotate_app as app
        case "pairs":
            from kb.cli.commands.pairs import app
        case "tasks":
            from kb.cli.commands.derived import tasks_app as app
        case "clips":
            from kb.cli.commands.clips import app
        case "label":
            from kb.cli.commands.label import app
        case "links":
            from kb.cli.commands.derived import links_app as app
        case "release":
            from kb.cli.commands.publish import release_app as app
        case "report":
            from kb.cli.commands.derived import report_app as app
        case "status":
            from kb.cli.commands.status import app
        case "doctor":
            from kb.cli.commands.doctor import app
        case "verify":
            from kb.cli.commands.maintain import verify_app as app
        case "profile":
            from kb.cli.commands.profile import app
        case "index":
            from kb.cli.commands.search import index_app as app
        case "search":
            from kb.cli.commands.search import search_app as app
        case "mcp":
            from kb.cli.commands.search import mcp_app as app
        case "query":
            from kb.cli.commands.query import app
        case "diff":
            from kb.cli.commands.query import diff_app as app
        case "explore":
            from kb.cli.commands.search import explore_app as app
        case "merge":
            from kb.cli.commands.maintain import merge_app as app
        case "refresh":
            from kb.cli.commands.maintain import refresh_app as app
        case "purge":
            from kb.cli.commands.maintain import purge_app as app
        case "sandbox":
            from kb.cli.commands.demo import sandbox_app as app
        case "demo":
            from kb.cli.commands.demo import demo_app as app
        case _:
            from kb.cli.framework.source_commands import app_of

            app = app_of(name)
    command: Any = app.commands.get(name, app)  # `kb report` is the only command of its group
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


messages.set_finder(find_command)


def context(path: str, command: Any) -> Any:
    """What click needs to show the help of `kb PATH` as `kb` itself shows it."""
    return typer.Context(command, info_name=f"kb {path}", **CONTEXT)


class Tree(typer.core.TyperGroup):
    """The root group: lists all commands, and loads only the one that is named."""

    leaves = staticmethod(leaves)

    def __init__(self, **attrs: Any) -> None:
        super().__init__(**attrs)
        # Names only; get_command finds what belongs to them.
        self.commands = dict.fromkeys(TREE)  # type: ignore[assignment]

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
        grouped = {name for names in GROUPS.values() for name in names}
        more = tuple(name for name in TREE if name not in grouped)
        for title, names in {**GROUPS, "More": more}.items():
            with formatter.section(title):
                formatter.write_dl([(name, TREE[name]) for name in names if name in TREE])

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
