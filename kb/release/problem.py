"""What the gate finds: one line each, with what to do."""

from __future__ import annotations

from typing import NamedTuple


class Problem(NamedTuple):
    """One reason not to publish. `where` is a folder, file or table; nothing here holds a secret."""

    check: str
    where: str
    what: str

    def __str__(self) -> str:
        return f"{self.check}: {self.where}: {self.what}"
