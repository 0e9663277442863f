"""`kb refresh youtube|reddit`: read again what the services' terms ask to keep fresh."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import typer

from kb.cli.command import command, group
from kb.cli.options import CLUSTER, Plan

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
    planned=("older_than", "metadata"),
    needs_data=True,
    examples=[
        "kb refresh youtube --wait",
        "kb refresh youtube --metadata            titles, descriptions and licences as well",
        "kb refresh youtube --limit 5000",
        "kb refresh youtube --older-than 0        everything, now",
    ],
)
def youtube(
    run: Run,
    older_than: OlderThan = None,
    metadata: Annotated[
        bool,
        typer.Option(
            "--metadata",
            help="Read all metadata again, not only statistics; spends the general quota.",
        ),
    ] = False,
    plan: Plan = False,
) -> Summary:
    """Read statistics older than the profile's max_age_days again and mark videos that vanished.

    One unit for 50 videos, of the quota that statistics have for themselves; videos that YouTube
    leaves out, and imported ones, are read in full from the general quota. YouTube's terms ask the
    same of titles and descriptions: --metadata. Run `kb youtube filter` and `export` afterwards.
    """
    from kb.youtube.refresh import plan_refresh, refresh

    do = plan_refresh if plan else refresh
    return do(run, older_than, metadata=metadata)


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
    from kb.reddit.plan import plan_refresh
    from kb.reddit.refresh import refresh

    return plan_refresh(run, older_than) if plan else refresh(run, older_than)
