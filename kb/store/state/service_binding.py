"""A data root remembers which services its data came from; mixing two would spoil both."""

from pathlib import Path
from urllib.parse import urlsplit

import msgspec

from kb.core.errors import OtherService
from kb.store.atomic import write_bytes
from kb.store.layout import Layout
from kb.store.rawlog import rawlog
from kb.store.state import json_files


def remember(root: Path, source: str, **facts: str) -> None:
    """Note a source's hosts, subreddit or wiki, or compare with what was noted.

    Addresses are compared by host and path, ports aside. What was noted binds once an answer is
    stored: a mistyped address that nothing came from does no harm. Raises OtherService (exit 2)
    before anything was sent or written.
    """
    new = {name: _host(value) for name, value in facts.items()}
    old = noted(root, source)
    other = [name for name, value in new.items() if old.get(name, value) != value]
    if other and not rawlog.any_answer(root, source):
        old, other = {}, []
    if other:
        raise OtherService(
            f"{root} holds {source} data of {other[0]} {old[other[0]]}, not {new[other[0]]}",
            hint="use another --data folder, or the settings it was made with",
        )
    if new.items() - old.items():
        noted_now = msgspec.json.encode({**old, **new}, order="sorted")
        write_bytes(Layout(root).identity(source), noted_now)


def noted(root: Path, source: str) -> dict[str, str]:
    """What was noted of a source; empty when nothing was. Raises DamagedData."""
    fix = "delete it; the next crawl records its services again"
    return json_files.read(Layout(root).identity(source), dict[str, str], fix=fix) or {}


def _host(value: str) -> str:
    parts = urlsplit(value)
    return f"{parts.hostname}{parts.path.rstrip('/')}" if parts.scheme else value
