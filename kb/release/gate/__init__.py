"""What the gate finds: one line each, with what to do."""

from typing import NamedTuple


class GateProblem(NamedTuple):
    """One reason not to publish.

    `where` is a folder, file or table; nothing here holds a secret.
    """

    check: str
    where: str
    what: str

    def __str__(self) -> str:
        return f"{self.check}: {self.where}: {self.what}"


def damaged(where: str, error: BaseException, do: str) -> GateProblem:
    """A file that can't be read, with the reason and what to do."""
    why = (str(error).splitlines() or [""])[0].strip()
    return GateProblem("damaged", where, f"can't be read ({why or type(error).__name__}); {do}")
