"""Figures of posts and comments, in the order of the report."""

from functools import partial

from kb.look.charts import BLUE, GREEN, ORANGE, PURPLE, RED, SKY
from kb.reddit.thread_figure import thread
from kb.report.figures import dates, funnel, logarithmic, toxicity, values
from kb.report.word_cloud import words

_POSTS, _COMMENTS = "reddit/posts", "reddit/comments"
_TYPES = {
    "text": BLUE,
    "image": ORANGE,
    "video": GREEN,
    "link": PURPLE,
    "poll": SKY,
    "gallery": RED,
}
FIGURES = (
    partial(funnel, name=_POSTS),
    partial(
        values,
        table=_POSTS,
        column="type",
        name="reddit-types",
        title="What kinds of posts there are",  # the paper's figure
        caption="{total} kept posts by type; a crosspost has its parent's type.",
        head=("type", "posts"),
        colors=_TYPES,
    ),
    partial(
        logarithmic,
        table=_POSTS,
        column="score",
        name="reddit-scores",
        title="How posts were voted",
        x="score of a post (logarithmic)",
        unit="points",
        color=PURPLE,
    ),
    partial(dates, table=_POSTS, column="created_utc", what="made", color=PURPLE),
    partial(funnel, name=_COMMENTS),
    partial(toxicity, table=_POSTS, columns=("toxicity_title", "toxicity_body")),
    partial(toxicity, table=_COMMENTS, columns=("toxicity_body",)),
    partial(
        words,
        name="reddit-words",
        tables={_POSTS: ("title", "body"), _COMMENTS: ("body",)},  # the paper's figure
    ),
    thread,
)
