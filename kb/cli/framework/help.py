"""What `--help` shows: a command's own options first, then shared ones, then examples."""

from __future__ import annotations

from typing import Any

import typer.core

from kb.cli.framework.options import COMMON, RUNNING
from kb.cli.framework.usage_errors import refuse_unknown


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
    """A command."""


class Group(_Sections, typer.core.TyperGroup):
    """A group of commands."""

    def resolve_command(self, ctx: Any, args: list[str]) -> Any:
        """The named command. Raises a usage error with suggestions for an unknown one."""
        refuse_unknown(self, ctx, args)
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
