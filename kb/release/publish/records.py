"""`state/deposits.json`: what was uploaded where, by service and folder or repository.

Ids and digests, no token. It is written before and after every step that can't be repeated.
"""

import json
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

from kb.core.errors import DamagedData
from kb.store.atomic import write_text
from kb.store.layout import Layout


def record_key(address: str, name: str) -> str:
    """The key of a folder or repository at a service. It begins with the host: the ports of a
    loopback service change with each start, hosts don't.
    """
    return f"{urlsplit(address).hostname}/{name}"


class Records:
    """The entries of one data root."""

    def __init__(self, root: Path) -> None:
        self.path = Layout(root).deposits

    def all(self) -> dict[str, Any]:
        """Every entry. Raises DamagedData."""
        if not self.path.exists():
            return {}
        try:
            state = json.loads(self.path.read_text(encoding="utf-8"))
        except ValueError:
            state = None
        if not isinstance(state, dict) or not all(
            isinstance(one, dict) and _is_entry(one) for one in state.values()
        ):
            raise DamagedData(
                f"{self.path} is damaged",
                hint="restore it, or move it away: then new drafts are made,"
                " also of what was published before",
            )
        return state

    def get(self, key: str) -> dict[str, Any]:
        """An entry; empty where there is none."""
        return dict(self.all().get(key, {}))

    def write(self, key: str, entry: dict[str, Any]) -> None:
        """Replace an entry."""
        write_text(
            self.path, json.dumps(self.all() | {key: entry}, indent=1, sort_keys=True) + "\n"
        )


def _is_entry(entry: dict[str, Any]) -> bool:
    """Whether an entry of the state reads as one of ours: of a deposit or of a repository."""
    if "repository" in entry:
        return isinstance(entry["repository"], str) and isinstance(entry.get("files"), dict)
    return all(isinstance(entry[name], int) for name in ("id", "draft") if name in entry) and (
        "id" in entry or "published" not in entry
    )
