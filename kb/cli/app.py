"""The command tree. A group's file is imported when one of its commands is named,
so `kb --help` stays quick.
"""

from __future__ import annotations

import functools
import importlib
from collections.abc import Iterator, Sequence
from typing import Annotated, Any

import typer
import typer.core
import typer.main

from kb import __version__
from kb.cli.framework import misplaced
from kb.core.sources import SPECS

DEFAULT = "kb.cli.commands.sources.default"  # of sources without commands of their own

# name -> (module, one line for `kb --help`). The module's `app` is a typer app, of one command or
# several.
TREE = {
    **{name: (spec.commands or DEFAULT, spec.help) for name, spec in SPECS.items()},
    "restore": (
        "kb.cli.commands.restore",
        "The content of a downloaded release, with your own keys.",
    ),
    "models": ("kb.cli.commands.models", "The toxicity model's files: fetch."),
    "annotate": ("kb.cli.commands.sources.annotate", "Toxicity scores for text that has none yet."),
    "pairs": ("kb.cli.commands.pairs", "Keyword-matched video-text pairs."),
    "links": (
        "kb.cli.commands.links",
        "Entities, and where videos, wiki and threads speak of them.",
    ),
    "release": (
        "kb.cli.commands.release",
        "Checks, metadata and checksums around release/; publish.",
    ),
    "report": ("kb.cli.commands.report", "Figures and one HTML page of what was collected."),
    "status": ("kb.cli.commands.status.command", "Progress, quota, age of the data, what is left."),
    "verify": (
        "kb.cli.commands.verify",
        "Every byte: whole, damaged, missing or foreign; --repair.",
    ),
    "profile": (
        "kb.cli.commands.profile.command",
        "A new domain's profile; what is wrong with one.",
    ),
    "index": ("kb.cli.commands.index", "One local index over everything that is clean."),
    "search": (
        "kb.cli.commands.search",
        "Ranked answers out of the index, with links to the place.",
    ),
    "mcp": (
        "kb.cli.commands.mcp",
        "Search and tables for agents (Model Context Protocol on stdio).",
    ),
    "query": ("kb.cli.commands.query", "SQL over the tables of the data root, by DuckDB."),
    "refresh": (
        "kb.cli.commands.sources.refresh",
        "Read again what the services' terms ask to keep fresh.",
    ),
    "purge": (
        "kb.cli.commands.sources.purge",
        "Remove for good what was deleted at its source, or named.",
    ),
    "sandbox": (
        "kb.cli.commands.sandbox",
        "Invented services on this machine, to try everything on.",
    ),
    "demo": ("kb.cli.commands.demo", "The whole job on the sandbox: no key, no network, minutes."),
}
CONTEXT: dict[str, Any] = {"help_option_names": ["--help", "-h"]}  # groups inherit it


class Tree(typer.core.TyperGroup):
    """The root group: knows every group's name and line, loads the one that is asked for."""

    def __init__(self, **attrs: Any) -> None:
        super().__init__(**attrs)
        # Names only, for listing and guessing; get_command() loads the one that is asked for.
        self.commands = dict.fromkeys(TREE)  # type: ignore[assignment]  # typer wants commands

    def get_command(self, ctx: Any, cmd_name: str) -> Any:
        """The group's own command object, or None for an unknown name."""
        return _loaded(cmd_name) if cmd_name in TREE else None

    def leaves(self) -> Iterator[tuple[str, Any]]:
        """("youtube crawl", its click command) of every command that does something, in order."""
        for name in TREE:
            yield from _leaves_of(name)

    def parse_args(self, ctx: Any, args: list[str]) -> Any:
        """`kb help COMMAND` is `kb COMMAND --help`."""
        if args[:1] == ["help"]:
            args = [*args[1:], "--help"]
        return super().parse_args(ctx, args)

    def resolve_command(self, ctx: Any, args: list[str]) -> Any:
        """The command that is named; another word is answered with the commands it may mean."""
        misplaced.refuse_unknown(self, ctx, args)
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


@functools.cache
def _loaded(name: str) -> Any:
    """A command of the tree, whose file is imported."""
    module = importlib.import_module(TREE[name][0])
    command = typer.main.get_command(
        module.app_of(name) if TREE[name][0] == DEFAULT else module.app
    )
    command.name = name
    return command


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


def leaves() -> Iterator[tuple[str, Any]]:
    """`Tree.leaves`."""
    return Tree().leaves()


def context(path: str, command: Any) -> Any:
    """What click needs to show the help of `kb PATH`, as `kb` itself has it."""
    return typer.Context(command, info_name=f"kb {path}", **CONTEXT)


def named(words: Sequence[str]) -> Any | None:
    """The click command that a line (without its `kb`) begins with; None where there is none."""
    if not words or words[0] not in TREE:
        return None
    found = dict(_leaves_of(words[0]))
    return found.get(" ".join(words[:2])) or found.get(words[0])


def _leaves_of(name: str) -> Iterator[tuple[str, Any]]:
    command = _loaded(name)
    inner = getattr(command, "commands", {})
    if not inner or command.invoke_without_command:
        yield name, command
    for child, leaf in inner.items():
        yield f"{name} {child}", leaf
