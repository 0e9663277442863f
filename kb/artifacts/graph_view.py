"""The graph of artifacts as people look at it: what is made of what, by which recipe and command,
and what is current.
"""

from collections.abc import Iterator, Sequence
from typing import NamedTuple

from kb.artifacts import freshness
from kb.core.config.pipeline import digests
from kb.core.config.profile import Profile
from kb.core.context import Run
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
