"""Purge (MineDojo paper, datasheet: maintenance, "if others want to be removed").

What was deleted at its source, or named, leaves every folder for good.

    derived    everything that is made of the source is removed at once, and made again at the end
    raw        tombstones, raw answers, frontier: the source's own
    kept       rows of what can't be made again: restored rows, labels
    scores     annotations of texts that no row has any more
"""

from collections.abc import Iterable
from pathlib import Path

import msgspec

from kb.annotate.scores import drop_unused
from kb.artifacts import domain_binding, freshness, manifest
from kb.artifacts import purge as steps
from kb.artifacts.makers import failure, make_outdated
from kb.artifacts.purge import PurgeRules
from kb.artifacts.purge_named import PurgeList
from kb.artifacts.purge_people import PeopleList
from kb.core.context import Run
from kb.core.errors import KbError
from kb.core.summary import Summary
from kb.crawl.purge import dry_purge, remove_keys
from kb.filters.filter_run import texts
from kb.registry import SOURCES
from kb.store import lock


def purge(
    run: Run, source: str, ids: Path | None, people: Path | None = None, *, build: bool = True
) -> Summary:
    """Every step, while nobody else writes what it touches. `ids` is a list of items to remove,
    `people` one of those whose items are. Without `build` the caller makes again what was removed.

    After an interruption the same command continues.
    """
    rules, listed, asked = _asked_for(source, ids, people)
    with domain_binding.writing(run, *lock.of_purge(source)):
        purge, removed = remove_keys(run, SOURCES[source].connector(run), rules, listed, asked)
        scores = 0
        if purge.removed:
            with manifest.editing(run.root, f"annotations/{source}"):
                scores = drop_unused(run.root, source, texts(run, source))
        counts = {"rows": sum(line.count for line in removed), "scores": scores, **purge.counts}
        about = {"command": f"purge {source}", "source": source}
        summary = Summary({**about, **purge.summary(), **counts})
        steps.finish(purge)
        if purge.damage is not None:
            purge.damage.summary = summary
            raise purge.damage
        if build:
            try:
                make_again(run)
            except KbError as error:  # what can't be made again is gone all the same
                error.summary = summary
                raise
    return summary


def make_again(run: Run) -> None:
    """Make what purges removed. Raises what `failure` gives; what fails is gone all the same."""
    outdated = freshness.plan(run, manifest.vacant(run.root))
    if error := failure(list(make_outdated(run, outdated))):
        raise error


def plan(run: Run, source: str, ids: Path | None, people: Path | None = None) -> Summary:
    """The same as a dry run: what would be removed, by table and folder."""
    rules, listed, asked = _asked_for(source, ids, people)
    connector = SOURCES[source].connector(run)
    with dry_purge(run, connector, rules, listed, asked) as purge:
        counted = (steps.derived, steps.answers, steps.kept) if purge.removed else ()
        return _plan_summary(purge, (line for step in counted for line in step(purge)))


def _asked_for(
    source: str, ids: Path | None, people: Path | None
) -> tuple[PurgeRules, PurgeList | None, PeopleList | None]:
    """The rules of a source, and what the user named. Raises SettingError."""
    rules = SOURCES[source].purge_rules()
    listed = rules.read_ids(ids, None) if ids else None
    return rules, listed, rules.people.read_people(people) if rules.people and people else None


def _plan_summary(purge: steps.Purge, lines: Iterable[steps.PurgeLine]) -> Summary:
    """The counts of a dry run, in all and by folder."""
    lines = [line for line in lines if line.count]

    def total(folder: str) -> int:
        return sum(line.count for line in lines if line.folder.split("/")[0] == folder)

    return Summary(
        command=f"purge {purge.rules.source} --plan",
        source=purge.rules.source,
        **purge.summary(),
        answers=total("raw"),
        rows=total("clean"),
        pairs=total("pairs"),
        links=total("links"),
        released=total("release"),
        lines=[msgspec.to_builtins(line) for line in lines],
        **purge.counts,
    )
