"""Click classes of commands: the order of options in `--help`, suggestions, `--dumps FILE…`."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import typer.core

from kb.cli.framework.options import COMMON, DUMPS, RUNNING
from kb.cli.framework.usage_errors import refuse_options_before_command, refuse_unknown


class _Sections:
    """For a command, and for a group that is a command as well (`kb pairs`, `kb release`)."""

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
        takes_folders = any(one.param_type_name == "argument" for one in self.params)
        return super().parse_args(ctx, _repeat_option(args, takes_folders))


def _repeat_option(args: list[str], takes_folders: bool) -> list[str]:
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
    return words
