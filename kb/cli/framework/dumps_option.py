"""`--dumps FILE…`: several files after one option, as a shell expands `*.zst`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from kb.cli.framework.help import Command

NAME = "--dumps"
Dumps = Annotated[
    list[Path] | None,
    typer.Option(
        NAME,
        metavar="FILE...",
        help="Archive dumps of posts and comments (zstd, zst_blocks, gzip or plain NDJSON), or a"
        " folder of them, to read instead of asking Reddit. Needs no key and no network.",
    ),
]


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
            inside = word == NAME
        elif inside and before != NAME:
            if takes_folders and Path(word).is_dir():
                inside = False
            else:
                words.append(NAME)
        words.append(word)
    return words
