"""What a check of a profile finds: how bad it is, where it stands, what it is, how to mend it."""

from __future__ import annotations

from typing import NamedTuple

ERROR = "error"  # the profile can't be used as it is
WARNING = "warning"  # it can be used, and hardly does what was meant
NOTE = "note"  # good to know
LEVELS = (ERROR, WARNING, NOTE)


class Finding(NamedTuple):
    """`file` is a name; `line` counts from 1, 0 for none; `key` as in `youtube.min_views`."""

    level: str
    file: str
    line: int
    key: str
    what: str
    mend: str

    @property
    def where(self) -> str:
        """profile.toml:12"""
        return f"{self.file}:{self.line}" if self.line else self.file

    def sentence(self) -> str:
        """The finding in one line."""
        return f"{self.where}: {self.what}" + (f": {self.mend}" if self.mend else "")


def worst_first(findings: list[Finding]) -> list[Finding]:
    """Errors, then warnings, then notes; each as they stand, the profile first."""

    def place(one: Finding) -> tuple[int, bool, str, int]:
        return LEVELS.index(one.level), not one.file.endswith(".toml"), one.file, one.line

    return sorted(findings, key=place)
