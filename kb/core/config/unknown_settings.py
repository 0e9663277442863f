"""Names in `.env` and in the environment that look like settings of Lorecrawl but are unknown."""

import difflib
import os
from collections.abc import Iterable
from pathlib import Path

from dotenv import dotenv_values

from kb.core.config.settings import Settings

_OURS = ("KB_", "YOUTUBE_", "REDDIT_", "ZENODO_")
_OF_TESTS = ("KB_TEST_", "KB_BENCH_", "KB_RECORDED")


def unknown_names(*, dotenv: bool = True) -> list[str]:
    """One line for each name, with the nearest right one, and never with its value.

    Other programs have settings that begin with YOUTUBE_ or REDDIT_: in the environment only
    KB_ is ours.
    """
    lines = []
    if dotenv and Path(".env").is_file():
        lines += _lines(".env", dotenv_values(".env", interpolate=False), _OURS)
    return lines + _lines("the environment", os.environ, ("KB_",))


def _lines(where: str, names: Iterable[str], prefixes: tuple[str, ...]) -> list[str]:
    known = [name.upper() for name in Settings.model_fields]
    lines = []
    for name in names:
        upper = name.upper()
        if not upper.startswith(prefixes) or upper in known or upper.startswith(_OF_TESTS):
            continue
        near = difflib.get_close_matches(upper, known, n=1, cutoff=0.6)
        guess = f"; did you mean {near[0]}?" if near else "; see .env.example"
        lines.append(f"{name} in {where} is no setting and has no effect{guess}")
    return lines
