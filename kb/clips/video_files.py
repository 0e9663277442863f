"""Where the files of videos are: `ID.ext`, `TITLE [ID].ext` as yt-dlp names them, or `ID/…`."""

import os
import re
from collections.abc import Collection, Iterable
from pathlib import Path

_ENDINGS = frozenset(
    (".mp4", ".m4v", ".mkv", ".webm", ".mov", ".avi", ".flv", ".ts", ".3gp", ".mpg", ".mpeg")
)
_BRACKETS = re.compile(r"\[([^][]+)\]$")


def video_files(folders: Iterable[Path], ids: Collection[str]) -> dict[str, Path]:
    """By video id: its file in these folders or below them. Of several the first one by folder
    and name counts. Raises OSError for a folder that can't be read.
    """
    wanted, paths = frozenset(ids), dict[str, Path]()
    for folder in folders:
        for where, below, files in os.walk(folder, onerror=_refuse):
            below.sort()
            for path in (Path(where, name) for name in sorted(files)):
                if path.suffix.lower() not in _ENDINGS:
                    continue
                titled = _BRACKETS.search(path.stem)
                named = (path.stem, titled[1] if titled else "", path.parent.name)
                if key := next((one for one in named if one in wanted), ""):
                    paths.setdefault(key, path)
    return paths


def _refuse(error: OSError) -> None:
    raise error
