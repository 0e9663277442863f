"""The first screen of a card: what to type to have the content, and one picture of what is there.

The picture is text, as a card is read in many places: a bar for each step of the filters, or of
the most frequent keywords.
"""

from typing import Any, NamedTuple

from kb.core.source_spec import ReleaseSpec
from kb.core.sources import RELEASES
from kb.release.metadata.facts import ColumnFacts, Facts

WIDTH = 40  # of the longest bar, in characters


class Bar(NamedTuple):
    """One line of the picture."""

    name: str
    n: int
    bar: str


def first(facts: Facts) -> dict[str, Any]:
    """What templates/first_screen.md.jinja says of a folder."""
    return {
        "query": RELEASES[facts.source].query,
        "archive": next((one.name for one in facts.others if one.name.endswith(".tar")), None),
        "picture": picture(facts),
    }


def picture(facts: Facts) -> list[Bar]:
    """How much each stage left over, or how often the most frequent keywords are met."""
    spec = RELEASES[facts.source]
    if spec.stages:
        return _bars(_funnel(facts, spec))
    keyword = _column(facts, spec)
    return _bars(list(keyword.top) if keyword is not None else [])


def _funnel(facts: Facts, spec: ReleaseSpec) -> list[tuple[str, int]]:
    """What was read, then what was left behind each stage that dropped something."""
    dropped: dict[str, int] = {}
    for stage, _, n in facts.rejected:
        dropped[stage] = dropped.get(stage, 0) + n
    counted = spec.counted or (spec.main,)
    left = sum(one.rows for one in facts.tables if one.table.short in counted)
    left += sum(dropped.values())
    steps = [("read", left)]
    for stage in spec.stages:
        if stage in dropped:
            left -= dropped[stage]
            steps.append((f"after {stage}", left))
    return steps


def _bars(steps: list[tuple[str, int]]) -> list[Bar]:
    most = max((n for _, n in steps), default=0)
    return [Bar(name, n, "█" * max(1, round(WIDTH * n / most))) for name, n in steps if n]


def _column(facts: Facts, spec: ReleaseSpec) -> ColumnFacts | None:
    main = next((one for one in facts.tables if one.table.short == spec.main), None)
    columns = main.columns if main is not None else ()
    return next((one for one in columns if one.column.name == spec.pictured), None)
