"""Runs over made data, and the report of one source alone."""

from pathlib import Path
from typing import Any, NamedTuple

from kb.core.config.profile import load_profile
from kb.core.config.settings import load_settings
from kb.core.context import Run
from kb.core.summary import Summary


def a_run(root: Path, workers: int = 1) -> Run:
    return Run(load_settings(dotenv=False), load_profile("minecraft"), root, workers=workers)


class OfOne(NamedTuple):
    """The report of a root that has one source alone."""

    root: Path
    page: str
    summary: Summary
    warned: list[str]


def odd(name: str, made: list[dict[str, Any]]) -> None:
    """Markup in a title, labels of any script and sign."""
    for index, row in enumerate(made):
        if name == "reddit/posts":
            row["title"] = (
                '<script>alert("x")</script><img src=http://evil.example/x.png onerror=alert(1)>'
            )
        if "keyword" in row:
            row["keyword"] = ("$x_{", "採掘\n🧱", "a" * 80)[index % 3]
        if "channel_title" in row or name == "youtube/videos":
            row["channel_title"] = "$^$ 採掘"
