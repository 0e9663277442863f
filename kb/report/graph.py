"""The graph of artifacts as people look at it (`kb build --graph`): what is made of what, by which
recipe and command, and what is current. `--out FILE.svg` draws it: a column for each step from raw
answers on, a box for each artifact in the colour of its state.
"""

from collections import defaultdict
from collections.abc import Iterator, Sequence
from typing import NamedTuple

from kb.artifacts import freshness
from kb.core.config.pipeline import digests
from kb.core.config.profile import Profile
from kb.core.context import Run
from kb.look.charts import GREEN, GREY, INK, ORANGE, PALE, canvas, saved, shortened
from kb.store.artifact_registry import ARTIFACTS

CURRENT, STALE, NOT_MADE = "current", "out of date", "not made"


class GraphNode(NamedTuple):
    """An artifact. Without `reasons` one that is not made has nothing to be made from."""

    artifact: str
    inputs: tuple[str, ...]
    recipe: str
    command: str
    state: str = NOT_MADE
    reasons: Sequence[str] = ()

    @property
    def shown_state(self) -> str:
        """The state, and why."""
        if self.state == NOT_MADE:
            return NOT_MADE if self.reasons else f"{NOT_MADE}: there is nothing to make it from"
        return f"{STALE}: {', '.join(self.reasons)}" if self.reasons else self.state

    def lines(self) -> list[str]:
        """What `kb build --graph` prints of it."""
        made = f"from {', '.join(self.inputs)} by {self.recipe}, as `{self.command}` does"
        return [f"{self.artifact}  {self.shown_state}", f"    {made}"]


def declared(profile: Profile) -> Iterator[GraphNode]:
    """Everything that can be made again, each after its inputs."""
    for name, artifact in ARTIFACTS.items():
        if artifact.maker is not None:
            recipe = ", ".join(digests(profile, artifact.maker.recipe))
            yield GraphNode(name, artifact.inputs, recipe, artifact.command)


def nodes(run: Run, asked: Sequence[str] = ()) -> list[GraphNode]:
    """Everything, or what `kb build` with these names looks after, as it is in the data root.

    Raises SettingError, DamagedData.
    """
    possible = freshness.graph(run, asked or (*freshness.NAMES, *freshness.FORMATS))
    outdated = freshness.plan(run, possible)
    drawn = []
    for node in declared(run.profile):
        why = outdated.get(node.artifact, [])
        if node.artifact in possible:
            state = NOT_MADE if why == [freshness.NEVER_MADE] else STALE if why else CURRENT
            drawn.append(node._replace(state=state, reasons=why))
        elif not asked:
            drawn.append(node)
    return drawn


_COLUMN, _ROW = 2.6, 0.42  # inches
_LONGEST = 40  # letters of a reason
_COLOURS = {CURRENT: GREEN, STALE: ORANGE}


def drawn(nodes: Sequence[GraphNode]) -> bytes:
    """The graph as SVG."""
    places = _places(nodes)
    across = 1 + max((column for column, _ in places.values()), default=0)
    down = 1 + max((row for _, row in places.values()), default=0)
    sheet, axes = canvas(down * _ROW, width=across * _COLUMN)
    axes.set_axis_off()
    axes.set_xlim(-0.05, across)
    axes.set_ylim(down - 0.4, -0.6)
    for node in nodes:
        column, row = places[node.artifact]
        for source in node.inputs:
            if source in places:
                from_column, from_row = places[source]
                axes.plot([from_column, column], [from_row, row], color=PALE, zorder=1)
    states = {node.artifact: node for node in nodes}
    for name, (column, row) in places.items():
        own = states.get(name)
        colour = _COLOURS.get(own.state, GREY) if own is not None else INK
        box = {"boxstyle": "round,pad=0.25", "facecolor": "white", "edgecolor": colour}
        axes.text(column, row, name, color=INK, fontsize=8, va="center", bbox=box, zorder=2)
        if own is not None and own.state != CURRENT:
            why = shortened(", ".join(own.reasons) or own.shown_state, _LONGEST)
            axes.text(column, row + 0.42, why, color=colour, fontsize=5, va="center", zorder=3)
    return saved(sheet)["svg"]


def _places(nodes: Sequence[GraphNode]) -> dict[str, tuple[int, int]]:
    """Column and row of every artifact and of what is kept: each right of all its inputs."""
    columns: dict[str, int] = {}
    for node in nodes:
        for source in node.inputs:
            if not any(source == other.artifact for other in nodes):
                columns.setdefault(source, 0)
        columns[node.artifact] = 1 + max(columns.get(source, 0) for source in node.inputs)
    rows: dict[int, int] = defaultdict(int)
    places = {}
    for name, column in columns.items():
        places[name] = (column, rows[column])
        rows[column] += 1
    return places
