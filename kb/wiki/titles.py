"""`--titles FILE`: page titles from lines, a released Parquet file, or MineDojo's data.json."""

from __future__ import annotations

import json
from pathlib import Path
from urllib.parse import unquote, urlsplit

from kb.core.errors import SettingError


def read_titles(path: Path) -> list[str]:
    """The titles, each once, in order. Raises SettingError (exit 2)."""
    try:
        head = path.open("rb").read(4)
        if head == b"PAR1":
            titles = _parquet(path)
        elif path.suffix == ".json":
            titles = _json(path)
        else:
            titles = [line.strip() for line in path.read_text(encoding="utf-8").splitlines()]
    except OSError as error:
        raise SettingError(f"--titles {path} can't be read: {error.strerror}") from None
    except (UnicodeDecodeError, ValueError) as error:
        raise SettingError(f"--titles {path} can't be read: {error}") from None
    kept = [title.replace("_", " ").strip() for title in titles if title and not title.startswith("#")]
    if not kept:
        raise SettingError(f"--titles {path} holds no titles", hint="one title a line")
    return list(dict.fromkeys(kept))


def _parquet(path: Path) -> list[str]:
    import pyarrow.parquet as pq

    names = pq.read_schema(path).names
    if "title" not in names:
        raise SettingError(f"{path} has no column title", hint="give a released wiki pages file")
    return pq.read_table(path, columns=["title"])["title"].to_pylist()


def _json(path: Path) -> list[str]:
    """One data.json of MineDojo's wiki, or a list of them, of titles, or of addresses."""
    data = json.loads(path.read_text(encoding="utf-8"))
    return [_title(entry) for entry in (data if isinstance(data, list) else [data])]


def _title(entry: object) -> str:
    if isinstance(entry, str):
        return _of_address(entry) if entry.startswith(("http:", "https:")) else entry
    if isinstance(entry, dict):
        held = entry.get("metadata", entry)
        if held.get("url"):
            return _of_address(held["url"])
        if held.get("title"):
            return held["title"]
    raise ValueError("an entry has neither title nor url")


def _of_address(url: str) -> str:
    return unquote(urlsplit(url).path.rsplit("/wiki/", 1)[-1].lstrip("/"))
