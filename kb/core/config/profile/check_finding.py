"""What a check of a profile finds: how bad it is, where it stands, what it is, how to fix it."""

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
    fix: str

    @property
    def where(self) -> str:
        """profile.toml:12"""
        return f"{self.file}:{self.line}" if self.line else self.file

    def sentence(self) -> str:
        """The finding in one line."""
        return f"{self.where}: {self.what}" + (f": {self.fix}" if self.fix else "")


def worst_first(findings: list[Finding]) -> list[Finding]:
    """Errors, then warnings, then notes; each as they stand, the profile first."""

    def place(one: Finding) -> tuple[int, bool, str, int]:
        return LEVELS.index(one.level), not one.file.endswith(".toml"), one.file, one.line

    return sorted(findings, key=place)


UNREACHABLE, REFUSED, WRONG = 3, 1, 2  # exit codes that follow from what a service answers


class OnlineAnswer(NamedTuple):
    """What a service's answer means for the profile: a finding without its place, an exit code."""

    level: str
    key: str
    what: str
    fix: str = ""
    code: int = 0


class QuestionCost:
    """Requests and quota units of one question to a service, and the pages that it brought."""

    def __init__(self) -> None:
        self.requests = self.units = 0
        self.pages: list[str] = []

    def __str__(self) -> str:
        requests = "1 request" if self.requests == 1 else f"{self.requests} requests"
        return f"cost: {requests}, 1 search unit" if self.units else f"cost: {requests}"
