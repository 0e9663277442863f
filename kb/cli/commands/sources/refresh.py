"""`kb refresh youtube|reddit`: re-read data that the services' terms require to be fresh."""

from __future__ import annotations

from typing import Annotated

import typer

from kb.cli.framework.command import command, group
from kb.cli.framework.options import CLUSTER, Plan
from kb.core.context import Run
from kb.core.summary import Summary

app = group("Re-read data that the services' terms require to be fresh.")

OlderThan = Annotated[
    int | None,
    typer.Option(
        "--older-than",
        min=0,
        metavar="DAYS",
        help="Re-read data older than this; 0: all of it. [default: the profile's max_age_days]",
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
        "kb refresh youtube --older-than 7        also view counts older than a week",
    ],
)
def youtube(run: Run, older_than: OlderThan = None, plan: Plan = False) -> Summary:
    """Re-read metadata older than the profile's max_age_days, and mark videos that are gone.

    Costs one unit of the general quota for 50 videos. A smaller --older-than also re-reads the
    counts of videos whose metadata are fresh, from the separate quota for statistics.
    Run `kb youtube filter` and `kb youtube export` afterwards.
    """
    from kb.youtube.crawl.refresh import plan_refresh, refresh

    do = plan_refresh if plan else refresh
    return do(run, older_than)


@command(
    app,
    uses=(*CLUSTER, "wait"),
    limit="Stop after N more posts and comments (exit code 3); the next run resumes.",
    again="Select once more what is due, including what was missing last time, instead of resuming"
    " a stopped refresh.",
    json="crawled, missing, failed, pending, requests",
    planned=(*CLUSTER, "older_than", "again"),
    needs_data=True,
    examples=[
        "kb refresh reddit --wait",
        "kb refresh reddit --older-than 0         everything, now: a removal request came in",
    ],
)
def reddit(run: Run, older_than: OlderThan = None, plan: Plan = False) -> Summary:
    """Re-read scores, removals and deletions with your own app's key, 100 ids per request.

    Run `kb reddit filter` and `kb reddit export` afterwards.
    """
    from kb.reddit.crawl.refresh import refresh
    from kb.reddit.plan import plan_refresh

    return plan_refresh(run, older_than) if plan else refresh(run, older_than)
