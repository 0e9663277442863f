"""The command that rebuilds a file of the data root, by its path."""

from __future__ import annotations

from pathlib import Path

from kb.core.sources import SOURCES

_LAYOUTS = {
    "youtube_full.json": "kb youtube export --format minedojo",
    "youtube_tutorial.json": "kb youtube export --format minedojo",
    "wiki_full": "kb wiki export --format minedojo",
    "reddit.json": "kb reddit export --format minedojo",
    "pairs.json": "kb pairs --format minedojo",
    "convokit": "kb reddit export --format convokit",
    "clip4mc": "kb pairs --format clip4mc",
    "video2dataset": "kb pairs --format video2dataset",
    "reconstructed": "kb reddit reconstruct",
}  # what makes a file or folder below export/


def advice(path: Path) -> str:
    """The command that rebuilds a file of a data root."""
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
    command = _made_by(path)
    return f"run `{command}` again" if command else "restore it from a copy"


def _made_by(path: Path) -> str:
    """The command that makes a file of export/ or report/ again, "" for one of another place."""
    parts = path.parts
    if "report" in parts[-3:-1]:
        return "kb report"
    below = parts[len(parts) - parts[::-1].index("export") :] if "export" in parts else ()
    return next((_LAYOUTS[name] for name in below if name in _LAYOUTS), "")
