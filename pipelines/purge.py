"""Purge (MineDojo paper, datasheet: maintenance, "if others want to be removed").

What was deleted at its source, or named, leaves every folder for good; what was made of it is made
again.

    raw        tombstones, raw answers, frontier: the source's own
    index      removed; the next search builds it again
    rows       of tables, of rejected, failed and pending; pairs, tasks, links
    scores     annotations of texts that no row has any more
    exports    release/, export/, links/ and report/ as far as they are there
"""

import shutil
from pathlib import Path

from kb.annotate.scores import drop_unused
from kb.artifacts import domain_binding, freshness, manifest
from kb.artifacts import purge as steps
from kb.artifacts.freshness import sources_of
from kb.artifacts.makers import FAILED, LEFT_OUT, make_outdated
from kb.artifacts.purge import PurgeLine, PurgeRules, Step
from kb.artifacts.purge_named import PurgeList
from kb.artifacts.purge_people import PeopleList
from kb.core.context import Run
from kb.core.errors import DamagedData
from kb.core.sources import MADE_OF, SOURCES
from kb.core.summary import Summary
from kb.crawl.purge import purge_answers
from kb.filters.filter_run import texts
from kb.release.build import describe
from kb.store import lock
from kb.store.artifact_registry import ARTIFACTS, RELEASE
from kb.store.layout import Layout

STEPS: tuple[Step, ...] = (steps.index, steps.rows, steps.exports)


def purge(run: Run, source: str, ids: Path | None, people: Path | None = None) -> Summary:
    """Every step, while nobody else writes what it touches. `ids` is a list of items to remove,
    `people` one of those whose items are.

    After an interruption the same command continues.
    """
    rules, listed, asked = _asked_for(source, ids, people)
    with domain_binding.writing(run, *lock.of_purge(source)):
        clean = f"clean/{source}"
        current = manifest.is_current(run.root, clean)
        purge = purge_answers(run, rules, listed, asked)
        removed: list[PurgeLine] = []
        scores = 0
        if purge.keys:
            list(steps.index(purge))
            removed = list(steps.rows(purge))
            if current:  # what was removed left raw/ and clean/ alike
                manifest.note_inputs(run.root, clean)
            with manifest.editing(run.root, f"annotations/{source}"):
                scores = drop_unused(run.root, source, texts(run, source))
            _write_again(run, source)
        counts = {"rows": sum(line.count for line in removed), "scores": scores, **purge.counts}
        about = {"command": f"purge {source}", "source": source}
        summary = Summary({**about, **purge.summary(), **counts})
        try:
            steps.finish(run.root, source)
        except DamagedData as error:
            error.summary = summary
            raise
    return summary


def plan(run: Run, source: str, ids: Path | None, people: Path | None = None) -> Summary:
    """The same as a dry run: what would be removed, by table and folder."""
    rules, listed, asked = _asked_for(source, ids, people)
    with steps.dry_purge(run, rules, listed, asked) as purge:
        counted = (steps.answers, *STEPS) if purge.keys else ()
        return steps.plan_summary(purge, (line for step in counted for line in step(purge)))


def _asked_for(
    source: str, ids: Path | None, people: Path | None
) -> tuple[PurgeRules, PurgeList | None, PeopleList | None]:
    """The rules of a source, and what the user named. Raises SettingError."""
    rules = SOURCES[source].purge_rules()
    listed = rules.read_ids(ids, None) if ids else None
    return rules, listed, rules.people.read(people) if rules.people and people else None


def _write_again(run: Run, source: str) -> None:
    """What is made of the source is made again, and what can't be is removed."""
    for parts in (Layout(run.root).pairing, Layout(run.root).linking):  # of unfinished builds
        shutil.rmtree(parts, ignore_errors=True)
    kept = (f"clean/{source}", f"index/{source}", "pairs", RELEASE)  # rows left them in place
    there = [
        name
        for name, artifact in ARTIFACTS.items()
        if source in sources_of(name) and name not in kept and artifact.folder(run.root).exists()
    ]
    for outcome in make_outdated(run, freshness.plan(run, there)):
        if outcome.outcome not in (FAILED, LEFT_OUT):
            continue
        if isinstance(outcome.error, DamagedData):
            raise outcome.error
        place = ARTIFACTS[outcome.artifact].folder(run.root)
        shutil.rmtree(place) if place.is_dir() else place.unlink(missing_ok=True)
        run.progress.say(f"{outcome.artifact} was removed: {outcome.error}")
    describe(run, [source, *MADE_OF])
