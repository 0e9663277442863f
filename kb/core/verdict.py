"""Four answers and no fifth: every crawled item is kept, rejected, failed or pending."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

from kb.core.errors import CountMismatch


@dataclass(frozen=True, slots=True)
class Tally:
    """How many items got which answer, in one shard, table or source."""

    crawled: int = 0
    kept: int = 0
    rejected: int = 0
    failed: int = 0
    pending: int = 0

    def __add__(self, other: Tally) -> Tally:
        return Tally(
            *(a + b for a, b in zip(asdict(self).values(), asdict(other).values(), strict=True))
        )

    def check(self, what: str) -> Tally:
        """Itself, or CountMismatch when items were lost or doubled."""
        answered = self.kept + self.rejected + self.failed + self.pending
        if answered != self.crawled:
            raise CountMismatch(
                f"{what}: {self.crawled} crawled, but {self.kept} kept + {self.rejected} rejected"
                f" + {self.failed} failed + {self.pending} pending = {answered}",
                hint="this is a defect of Lorebase; no output was replaced",
            )
        return self


class Summary(dict[str, Any]):
    """What a command did: the numbers of its last line (`--json`), in order."""

    def line(self) -> str:
        """One line for a person: `crawled 120, kept 80 …`; empty values are left out."""
        return ", ".join(
            f"{name.replace('_', ' ')} {value}"
            if isinstance(value, (int, float))
            else f"{name.replace('_', ' ')}: {value}"
            for name, value in self.items()
            if value is not None and not isinstance(value, (dict, list))
        )
