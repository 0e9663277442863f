"""Posts and comments that `kb restore` brings back by their names: what it takes, and doing it."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from pathlib import Path

from kb.core.context import Run
from kb.core.plan import PlanPart, PlanPhase
from kb.core.profile.reddit import RedditSection
from kb.core.verdict import Summary
from kb.reddit import credentials
from kb.reddit.plan import plan_rebuild
from kb.reddit.reconstruction import WITHOUT_KEY, rebuild
from kb.store.layout import Layout

Dumps = Sequence[Path]  # archive files that are read instead of asking Reddit


def check(run: Run, folders: Sequence[Path], dumps: Dumps, others: Sequence[str]) -> None:
    """Raises ProfileError without [reddit], MissingCredential for all settings that it and the
    `others` need.
    """
    if folders:
        run.profile.section(RedditSection)
    if folders and not dumps:
        credentials.require(run, *others, without=WITHOUT_KEY)
    else:
        run.settings.require(*others)


def bring(run: Run, folders: Sequence[Path], dumps: Dumps, gone: Collection[str]) -> Summary:
    """Read what released folders name into restored/reddit. `gone` were purged elsewhere.

    Raises as `rebuild`.
    """
    place = Layout(run.root).restored("reddit")
    return rebuild(run, [*folders], place, dumps=dumps, gone=gone)


def plan(run: Run, folders: Sequence[Path], dumps: Dumps) -> PlanPart:
    """What would be asked for, of whom. Raises SettingError."""
    if not folders:
        return PlanPart()
    whom = "dumps, no key" if dumps else f"Reddit, {run.settings.named('reddit_client_id')}"
    summary = plan_rebuild(run, [*folders], dumps)
    return PlanPart(
        [PlanPhase(**one).of(whom) for one in summary["phases"]], [str(summary["assumed"])]
    )
