"""How a file of the data root is made again, by where it is."""

from __future__ import annotations

from pathlib import Path

SOURCES = ("youtube", "wiki", "reddit")


def advice(path: Path) -> str:
    """What to type to have a file of a data root again."""
    match path.parts[::-1]:
        case (_, _, source, "clean", *_) if source in SOURCES:
            return f"run `kb {source} filter` again"
        case (_, source, "clean", *_) if source in SOURCES:
            return f"run `kb {source} filter` again"
        case (_, _, _, "restored", *_) | (_, _, "restored", *_) | (_, "restored", *_):
            return "remove its folder, then run `kb restore` with the release's folder again"
        case (_, "pairs", *_) | (_, _, "pairs", "state", *_):
            return "run `kb pairs --again`"
        case (_, "links", *_) | (_, _, "links", "state", *_):
            return "run `kb links --again`"
        case (_, source, "release", *_):
            return f"run `kb {source} export` again"
        case (_, source, "annotations", *_):
            return f"remove it, then run `kb {source} filter`: what it held is scored again"
        case ("tombstones.parquet", _, "raw" | "state", *_):
            return "run `kb verify --repair`: its copy takes its place"
    return "put it back from a copy"
