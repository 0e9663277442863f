"""`--dumps FILE…`: several files behind one option, as a shell's `*.zst` gives them."""

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
        help="Archive dumps (zstd, zst_blocks, gzip or plain NDJSON) or a folder of them, to read"
        " instead of asking Reddit, without a key or network; those of posts and of comments"
        " alike.",
    ),
]


class DumpsCommand(Command):
    """Every word behind --dumps up to the next option is a file of it. Where the command itself
    takes folders, only a folder right behind --dumps belongs to it.
    """

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """The arguments with --dumps before each file."""
        takes_folders = any(one.param_type_name == "argument" for one in self.params)
        return super().parse_args(ctx, _each(args, takes_folders))


def _each(args: list[str], takes_folders: bool) -> list[str]:
    words: list[str] = []
    inside = False
    for place, word in enumerate(args):
        if word.startswith("-"):
            inside = word == NAME
        elif inside and args[place - 1] != NAME and not (takes_folders and Path(word).is_dir()):
            words.append(NAME)
        elif inside and args[place - 1] != NAME:
            inside = False
        words.append(word)
    return words
