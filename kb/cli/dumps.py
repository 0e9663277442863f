"""`--dumps FILE…`: several files behind one option, as a shell's `*.zst` gives them."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from kb.cli.help import Command

NAME = "--dumps"
Dumps = Annotated[
    list[Path] | None,
    typer.Option(
        NAME,
        metavar="FILE...",
        help="Archive dumps (.zst) to read instead of asking Reddit, without a key or network;"
        " those of posts and of comments alike.",
    ),
]


class DumpsCommand(Command):
    """Every word behind --dumps up to the next option is a file of it; a folder is not."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """The arguments with --dumps before each file."""
        return super().parse_args(ctx, _each(args))


def _each(args: list[str]) -> list[str]:
    words: list[str] = []
    inside = False
    for place, word in enumerate(args):
        if word.startswith("-"):
            inside = word == NAME
        elif inside and args[place - 1] != NAME and not Path(word).is_dir():
            words.append(NAME)
        elif inside and args[place - 1] != NAME:
            inside = False
        words.append(word)
    return words
