"""Reddit (MineDojo paper, appendix "Reddit": data collection and filtering).

1. read every post of the domain's subreddit that the API or the archive dumps have; 2. and all of
its comments with their parents, so that threads can be rebuilt; 3. drop removed and adult posts and
those below the score, tell the types of posts apart; 4. score titles, bodies and comments with
Detoxify and drop above the threshold. Released: ids, structure and figures; `kb reddit reconstruct`
brings content back with the user's own key.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

from kb.annotate import toxicity
from kb.core.context import Run
from kb.core.profile import Profile
from kb.core.verdict import Summary
from kb.export import convokit, minedojo_reddit, parquet
from kb.filters.chain import Chain, Clean
from kb.filters.judgement import Predicate
from kb.filters.predicates import AtLeast, AtMost, In, NotIn, NotTrue, Present, Waits
from kb.reddit import parse
from kb.reddit.assemble import HELPERS, assemble, with_posts
from kb.reddit.state import gave_up, incomplete
from kb.reddit.threads import counted

THERE = (
    NotTrue("missing", stage="missing", reason="missing"),
    In("state", ("there",), stage="missing"),
)
GONE = ("deleted", "removed")
POST, COMMENT = {"title": "toxicity_title", "body": "toxicity_body"}, {"body": "toxicity_body"}


def posts(p: Profile) -> tuple[Predicate, ...]:
    """The stages of a post."""
    return (
        *THERE,
        Present("created_utc", stage="missing"),
        NotIn("gone", GONE, stage="removed"),
        Present("title", stage="removed"),
        Present("over_18", stage="nsfw"),
        NotTrue("over_18", stage="nsfw", reason="over_18"),
        AtLeast("score", p.section("reddit").min_score, stage="score"),
        *toxic(p, POST),
    )


def comments(p: Profile) -> tuple[Predicate, ...]:
    """The stages of a comment; a stub that was not resolved yet waits."""
    return (
        Waits("state", ("stub",), stage="missing", reason="more"),
        *THERE,
        *(Present(column, stage="missing") for column in ("created_utc", "parent_id")),
        NotIn("post", ("absent", "not_kept"), stage="post"),
        NotIn("gone", GONE, stage="removed"),
        Present("body", stage="removed"),
        *toxic(p, COMMENT),
    )


def toxic(p: Profile, scored: dict[str, str]) -> tuple[Predicate, ...]:
    """No category of any text above the profile's threshold."""
    limit = p.toxicity.threshold("reddit")
    return tuple(
        AtMost(to, limit, stage="toxicity", null_passes=True, reason=of)
        for of, to in scored.items()
        if limit is not None
    )


def clean(p: Profile) -> Clean:
    """Raw answers, live ones and dumps, to clean posts and comments."""
    return Clean(
        source="reddit",
        kinds={of: parse.raw_kind(of, p.section("reddit").links) for of in parse.KINDS},
        assemble=assemble,
        chains=(
            Chain(
                "reddit/posts",
                "post_id",
                posts(p),
                prefix="t3_",
                scores=POST,
                helpers=HELPERS,
                told=("type",),
            ),
            Chain(
                "reddit/comments",
                "comment_id",
                comments(p),
                prefix="t1_",
                scores=COMMENT,
                helpers=HELPERS,
                relate=with_posts,
            ),
        ),
        scorer=toxicity,
        unanswered=gave_up,
        ended_by_failure=("more",),
        complete=counted,
        about=incomplete,
    )


def export(run: Run, format: str) -> Summary:
    """Clean to release/reddit, or to export/<format>."""
    write: dict[str, Callable[[Run], Summary]] = {
        "parquet": partial(parquet.export, source="reddit"),
        "minedojo": minedojo_reddit.export,
        "convokit": convokit.export,
    }
    return Summary(write[format](run) | incomplete(run.root))
