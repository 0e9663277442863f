"""Reddit (MineDojo paper, appendix "Reddit": data collection and filtering).

1. every post of the domain's subreddit that the API or the archive dumps have; 2. all comments with
their parents, so that threads can be rebuilt; 3. drop removed and adult posts and those below the
score, tell the types of posts apart; 4. score titles, bodies and comments with Detoxify, drop above
the threshold. Released: ids and figures; `kb reddit reconstruct` brings content back with a key.
"""

from functools import partial
from typing import Any

from kb.annotate import toxicity
from kb.core.config.profile import Profile
from kb.core.context import Run
from kb.core.summary import Summary
from kb.export import layouts
from kb.filters.chain import Chain, Clean, Description, GivenUp, PurgeKeys, RawRows
from kb.filters.predicates import AtLeast, In, NotIn, NotTrue, Predicate, Present, Waits, none_above
from kb.reddit import status
from kb.reddit.parse.answers import KINDS, raw_kind
from kb.reddit.parse.assemble import HELPERS, assemble, with_counts, with_posts
from kb.reddit.section import RedditSection
from kb.registry import PUBLISHED

THERE = (
    NotTrue("missing", stage="missing", reason="missing"),
    In("state", ("there",), stage="missing"),
)
GONE = ("deleted", "removed")
POST, COMMENT = {"title": "toxicity_title", "body": "toxicity_body"}, {"body": "toxicity_body"}
# What rejected rows keep for readers.
OF_POST = Description({"title": "title", "text": "body", "type": "type"}, "gone")
OF_COMMENT = Description({"text": "body", "post_id": "post_id", "parent_id": "parent_id"}, "gone")


def posts(p: Profile) -> tuple[Predicate, ...]:
    """The stages of a post."""
    return (
        *THERE,
        Present("created_utc", stage="missing"),
        NotIn("gone", GONE, stage="removed"),
        Present("title", stage="removed"),
        Present("over_18", stage="nsfw"),
        NotTrue("over_18", stage="nsfw", reason="over_18"),
        AtLeast("score", p.section(RedditSection).min_score, "score", "reddit.min_score"),
        *none_above(p.toxicity.threshold("reddit"), POST, "toxicity.thresholds.reddit"),
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
        *none_above(p.toxicity.threshold("reddit"), COMMENT, "toxicity.thresholds.reddit"),
    )


def clean(p: Profile) -> Clean:
    """Raw answers, live ones and dumps, to clean posts and comments."""
    links = p.section(RedditSection).links
    each = partial(Chain, helpers=HELPERS, purged=PurgeKeys(person="author_hash"))
    return Clean(
        source="reddit",
        raw=RawRows({of: raw_kind(of, links) for of in KINDS}, assemble),
        chains=(
            each("reddit/posts", "post_id", posts(p), "t3_", POST, described=OF_POST),
            each(
                *("reddit/comments", "comment_id", comments(p), "t1_", COMMENT),
                relate=with_posts,
                described=OF_COMMENT,
            ),
        ),
        scorer=toxicity,
        given_up=GivenUp(status.failures, ends=("more",)),
        complete=with_counts,
        figures=lambda root, _: status.incomplete_count(root),
    )


def export(run: Run, source: str, format: str = "parquet", **options: Any) -> Summary:
    """clean/reddit to release/reddit, or to export/<format>, with what could be read in part."""
    made = layouts.export(run, PUBLISHED[source], format, **options)
    return Summary(made | status.incomplete_count(run.root))
