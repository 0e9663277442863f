"""`kb refresh youtube|reddit`: read again what the services' terms ask to keep fresh."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import typer

from kb.cli.framework.command import command, group
from kb.cli.framework.options import CLUSTER, Plan

if TYPE_CHECKING:
    from kb.core.context import Run
    from kb.core.verdict import Summary

app = group("Read again what the services' terms ask to keep fresh.")

OlderThan = Annotated[
    int | None,
    typer.Option(
        "--older-than",
        min=0,
        metavar="DAYS",
        help="Read what is older than this; 0: everything. [default: the profile's max_age_days]",
    ),
]


@command(
    app,
    uses=("wait",),
    limit="Stop after N more videos (exit code 3); the next run resumes.",
    json="crawled, missing, failed, pending, requests, units",
    planned=("older_than",),
    needs_data=True,
    examples=[
        "kb refresh youtube --wait",
        "kb refresh youtube --limit 5000",
        "kb refresh youtube --older-than 7        also counts that are older than a week",
    ],
)
def youtube(run: Run, older_than: OlderThan = None, plan: Plan = False) -> Summary:
    """Read metadata older than the profile's max_age_days again and mark videos that vanished.

    One unit of the general quota for 50 videos. With a smaller --older-than also the counts of
    videos whose metadata are fresh, from the quota that statistics have for themselves.
    Run `kb youtube filter` and `export` afterwards.
    """
    from kb.youtube.connector.refresh import plan_refresh, refresh

    do = plan_refresh if plan else refresh
    return do(run, older_than)


@command(
    app,
    uses=(*CLUSTER, "wait"),
    limit="Stop after N more posts and comments (exit code 3); the next run resumes.",
    again="Look once more for what is due, what was missing last time included, instead of"
    " resuming a stopped refresh.",
    json="crawled, missing, failed, pending, requests",
    planned=(*CLUSTER, "older_than", "again"),
    needs_data=True,
    examples=[
        "kb refresh reddit --wait",
        "kb refresh reddit --older-than 0         everything, now: a removal request came in",
    ],
)
def reddit(run: Run, older_than: OlderThan = None, plan: Plan = False) -> Summary:
    """Read scores, removals and deletions again, 100 ids a request, with your own app's key.

    With --again also what was missing the last time.
    Run `kb reddit filter` and `export` afterwards.
    """
    from kb.reddit.connector.plan import plan_refresh
    from kb.reddit.connector.refresh import refresh

    return plan_refresh(run, older_than) if plan else refresh(run, older_than)
