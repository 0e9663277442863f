"""Makes artifacts, alone or whatever is out of date in the order of the graph.

    make_artifact(run, "pairs")             by the recipe that its declaration names
    make_export(run, "pairs", "minedojo")   in a layout, as its command does
    obstacles(run, names)                   what stands in the way of making these
    make_outdated(run, plan(run, names))    those that are out of date, each after its inputs

The declarations (kb.store.artifact_registry) are the only place that says how an artifact is made;
commands, builds, purges and repairs all come through here.
"""

from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple

from kb.artifacts import freshness, manifest, texts
from kb.artifacts.freshness import Reasons
from kb.core.config.pipeline import recipe_of
from kb.core.context import Run
from kb.core.errors import (
    GLOBAL_STOPS,
    DamagedData,
    FatalError,
    KbError,
    NothingKept,
    NotReleasable,
    Stopped,
    UsageError,
    severity,
)
from kb.core.sources import PUBLISHED
from kb.core.summary import Summary
from kb.store.artifact_registry import ARTIFACTS, CHUNKS, RELEASE, exports_in
from kb.store.damage import forget_damage, note_damage

_NONE: Mapping[str, Any] = {}
MADE, UNCHANGED, FAILED, LEFT_OUT = "made", "unchanged", "failed", "left out"
STOPPED = "stopped"


class Outcome(NamedTuple):
    """What became of an artifact that was out of date, for `reasons`.

    It is made, unchanged (its inputs are the same after all), failed, stopped (with all that would
    have come after), or left out because of an input that failed, whose name is `cause`. `error`
    says why it failed, also of one that was made without rows.
    """

    artifact: str
    reasons: list[str]
    outcome: str
    error: KbError | None = None
    cause: str = ""

    def __str__(self) -> str:
        if self.outcome == LEFT_OUT:
            return f"{LEFT_OUT}: {f'{self.cause} failed' if self.cause else self.error}"
        return f"{FAILED}: {self.error}" if self.error else self.outcome


class Obstacle(NamedTuple):
    """What these artifacts can't be made without."""

    error: UsageError
    artifacts: list[str]

    def __str__(self) -> str:
        hint = f"; {self.error.hint}" if self.error.hint else ""
        return f"{', '.join(self.artifacts)} can't be made: {self.error}{hint}"


def obstacles(run: Run, outdated: Iterable[str]) -> list[Obstacle]:
    """What stands in the way of making these artifacts, each thing once: a recipe that may not run,
    a model, an extra, a wrong setting. A recipe says by `<function>_needs` what a function needs.
    """
    obstacles: dict[str, Obstacle] = {}
    for name in outdated:
        maker = ARTIFACTS[name].maker
        try:
            if maker is not None:
                needs = recipe_of(run.profile, maker.recipe).defined(
                    f"{maker.function}_needs", None
                )
                if needs is not None:
                    needs(run, *maker.arguments)
        except UsageError as error:
            obstacles.setdefault(str(error), Obstacle(error, [])).artifacts.append(name)
    return list(obstacles.values())


def made_of_these(names: Iterable[str], outdated: Iterable[str]) -> set[str]:
    """These artifacts and those of the outdated ones, which come after their inputs, that need
    them.
    """
    lost = set(names)
    for name in outdated:
        if lost.intersection(ARTIFACTS[name].inputs):
            lost.add(name)
    return lost


def make_artifact(run: Run, name: str, options: Mapping[str, Any] | None = None) -> Summary:
    """Make an artifact by its recipe; an export and the report by default with the options that
    they were made with.
    Returns the summary of its command.

    Files that are damaged are noted, so that a build makes them again. Raises SettingError for a
    recipe that may not run, and what the recipe raises.
    """
    maker = ARTIFACTS[name].maker
    if maker is None:
        raise ValueError(f"{name} is kept: nothing makes it again")
    given = recorded_options(run.root, name) if options is None else options
    make = recipe_of(run.profile, maker.recipe).defined(maker.function)
    try:
        summary: Summary = make(run, *maker.arguments, **given)
    except DamagedData as error:
        note_damage(run.root, error.paths)
        raise
    if name != RELEASE:  # which describes the folders of other artifacts
        forget_damage(run.root, ARTIFACTS[name].folder(run.root))
    return summary


def recorded_options(root: Path, name: str) -> dict[str, Any]:
    """The options with which an export or the report was made; none for one that was not, and for
    other artifacts. Raises DamagedData.
    """
    has_options = name == "report" or name.startswith("export/")
    made = manifest.read_manifest(root, name) if has_options else None
    options = dict(made.figures) if made is not None else {}
    if "tokenizer" in options and not Path(options["tokenizer"]).is_file():
        del options["tokenizer"]  # then words are counted
    if not name.endswith(CHUNKS):  # before they had a file of their own
        options.pop("chunk_tokens", None)
    return options


def make_export(run: Run, name: str, layout: str, options: Mapping[str, Any] = _NONE) -> Summary:
    """Make the release folder of what is published under that name, with those that are part of it,
    or another layout. Raises as `make_artifact`.
    """
    if layout != "parquet":
        return make_artifact(run, exports_in(layout, name, options)[0], options)
    made = make_artifact(run, f"release/{name}")
    for part in PUBLISHED:
        if PUBLISHED[part].part_of == name:
            more = make_artifact(run, f"release/{part}")
            made |= {what: n for what, n in more.items() if isinstance(n, int) and n}
    return made


def make_and_export(run: Run, name: str, layout: str = "parquet") -> Summary:
    """Make tables, then a layout of them; of restored tables only the layout. Raises likewise."""
    if layout != "parquet" and texts.is_restored(run.root, name):
        return make_export(run, name, layout)
    made = make_artifact(run, name)
    exported = make_export(run, name, layout)
    return Summary(made, **({"release": exported["path"]} if layout == "parquet" else exported))


def make_outdated(run: Run, outdated: Reasons) -> Iterator[Outcome]:
    """Make these artifacts, which come after their inputs, each if it is still out of date when its
    turn comes; a failure ends nothing but what is made of it.

    What concerns every artifact, as a full disk does, ends the rest. Raises SettingError before
    anything is made where a recipe may not run.
    """
    for name in outdated:
        if (maker := ARTIFACTS[name].maker) is not None:
            recipe_of(run.profile, maker.recipe)
    lost: dict[str, Outcome] = {}  # what is not there in today's form
    blocked: dict[str, KbError] = {}
    for obstacle in obstacles(run, outdated):
        run.progress.say(str(obstacle))
        blocked |= dict.fromkeys(obstacle.artifacts, obstacle.error)
    for name, why in outdated.items():
        outcome = _made(run, name, why, lost, blocked)
        if outcome.outcome in (FAILED, LEFT_OUT):
            lost[name] = outcome
        yield outcome
        if outcome.outcome == STOPPED:
            break
    if left_out := [outcome.artifact for outcome in lost.values() if outcome.cause]:
        run.progress.say(f"left out, as what they are made of failed: {', '.join(left_out)}")


def _made(
    run: Run,
    name: str,
    why: list[str],
    lost: Mapping[str, Outcome],
    blocked: Mapping[str, KbError],
) -> Outcome:
    for source in ARTIFACTS[name].inputs:
        if source in lost:
            return Outcome(name, why, LEFT_OUT, lost[source].error, lost[source].cause or source)
    try:
        if not freshness.reasons(run, name):
            return Outcome(name, why, UNCHANGED)
        if name in blocked:
            return _failed(name, why, blocked[name])
        run.progress.say(f"{name}: {', '.join(why)}")
        make_artifact(run, name)
    except GLOBAL_STOPS as error:
        return Outcome(name, why, STOPPED, error)
    except KbError as error:
        run.progress.say(f"{name} failed: {error}")
        return _failed(name, why, error)
    return Outcome(name, why, MADE)


def _failed(name: str, why: list[str], error: KbError) -> Outcome:
    """Where nothing was kept, the tables are there, without rows; a release that its owner has not
    signed is no failure.
    """
    outcomes = {NothingKept: MADE, NotReleasable: LEFT_OUT}
    outcome = next((outcomes[kind] for kind in outcomes if isinstance(error, kind)), FAILED)
    return Outcome(name, why, outcome, error)


def failure(outcomes: Iterable[Outcome]) -> KbError | None:
    """The error with which a command ends after these outcomes: the worst by `severity`."""
    failed = [
        (outcome.artifact, outcome.error)
        for outcome in outcomes
        if outcome.error is not None and outcome.outcome != LEFT_OUT
    ]
    if not failed:
        return None
    artifact, error = min(failed, key=lambda pair: severity(pair[1]))
    if isinstance(error, Stopped):
        return error
    more = f" (and {len(failed) - 1} more)" if len(failed) > 1 else ""
    return FatalError(f"{artifact}{more} failed: {error}", hint=error.hint)
