"""Figures of posts and comments, in the order of the report.

The last one is a thread as a tree: its post, its comments, and the places of those that were left
out.
"""

import textwrap
from functools import partial
from typing import Any

from kb.core.config.profile import Profile
from kb.look.charts import (
    BLUE,
    GREEN,
    GREY,
    INK,
    ORANGE,
    PALE,
    PURPLE,
    RED,
    SKY,
    WIDTH,
    Figure,
    canvas,
    number,
    printable,
    saved,
    shortened,
)
from kb.look.headings import reading
from kb.reader.thread import reading_order
from kb.report.data import ReportData
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
_REJECTED = "reddit/rejected"
_LINES = 14  # comments, at most
_LETTERS = 64  # of a line without indent, with its score
_PITCH = 0.172  # inches a line of text
_STEP = 0.16  # inches a level is further to the right


def thread(data: ReportData, profile: Profile) -> Figure | None:
    """The thread that shows most at a glance: of a size that fits, with answers to answers and,
    where there is one, a place from which a comment was left out.
    """
    chosen = data.rows(
        _COMMENTS,
        "SELECT post_id FROM {t} GROUP BY 1 HAVING count(*) BETWEEN 3 AND 60"
        " ORDER BY count(*) FILTER (NOT parent_in_release) > 0 DESC, least(max(depth), 3) DESC,"
        f" abs(count(*) - {_LINES - 2}), post_id LIMIT 1",
    )
    post = chosen and data.rows(
        _POSTS, "SELECT title, score, num_comments FROM {t} WHERE post_id = ?", chosen[0][0]
    )
    if not post:
        return None
    title, score, comments = post[0]
    nodes = _nodes(data, chosen[0][0])
    shown = nodes[:_LINES]
    more = len(nodes) - len(shown)
    n_left_out = sum(left_out for *_, left_out in nodes)
    return Figure(
        "reddit-thread",
        "One thread",
        f"A post with {len(nodes) - n_left_out:,} of its {comments:,} comments, each below what it"
        f" answers, with its score. Grey: {n_left_out:,} that were left out, by the reason."
        + (f" {more:,} more are not drawn." if more else ""),
        f"A tree of a post, {title!r}, and {len(shown)} comments down to level"
        f" {max((level for level, *_ in nodes), default=0) + 1}; {n_left_out} were left out.",
        saved(_drawn(title or "(no title)", score, shown)),
        ("level", "score", "text"),
        [(level + 1, score, text) for level, score, text, _ in nodes],
    )


def _nodes(data: ReportData, post_id: str) -> list[tuple[int, int | None, str, bool]]:
    """(level, score, text, whether it was left out) in reading order: the best answers first."""
    rows = data.rows(
        _COMMENTS,
        "SELECT 't1_' || comment_id, parent_id, score, body FROM {t}"
        " WHERE post_id = ? ORDER BY score DESC NULLS LAST, comment_id",
        post_id,
    )
    root = f"t3_{post_id}"
    there = {root, *(name for name, *_ in rows)}
    lost = {parent for _, parent, *_ in rows if parent not in there}
    dropped = data.rows(
        _REJECTED,
        "SELECT key, parent_id, stage, reason FROM {t}"
        " WHERE list_contains(?, key) OR (post_id = ? AND parent_id IS NOT NULL) ORDER BY key",
        sorted(lost),
        post_id,
    )
    parents = {name: parent for name, parent, *_ in rows}
    texts = {name: (points, " ".join((body or "").split())) for name, _, points, body in rows}
    reasons = dict.fromkeys(sorted(lost), "not there")
    for name, parent, stage, reason in dropped:
        column, why = ("stage", stage) if stage == "toxicity" else ("reason", reason)
        reasons[name] = reading("shared/rejected", column, why)
        if parent is not None:
            parents[name] = parent
    # What these answered is not known: they stand below the post, after the others.
    parents |= {name: None for name in reasons if name not in parents}
    return [
        (level, *texts[name], False)
        if name in texts
        else (level, None, f"[left out: {reasons[name]}]", True)
        for level, name in reading_order(parents, root)
    ]


def _drawn(title: str, score: int | None, nodes: list[tuple[int, int | None, str, bool]]) -> Any:
    """The tree, from the top: a line leads from each comment to what it answers."""
    blocks = [(-1, score, textwrap.wrap(printable(shortened(title, 100)), _LETTERS - 16), False)]
    for level, points, text, left_out in nodes:
        room = _LETTERS - 3 * min(level, 8) - 8
        lines = textwrap.wrap(printable(shortened(text, 2 * room - 6)), room)[:2] or [""]
        blocks.append((level, points, lines, left_out))
    height = sum(_PITCH * len(lines) + 0.1 for _, _, lines, _ in blocks) + 0.1
    sheet, axes = canvas(height)
    sheet.set_layout_engine("none")
    axes.set_position((0, 0, 1, 1))
    axes.set_xlim(0, WIDTH)
    axes.set_ylim(height, 0)
    axes.axis("off")
    top, trunks = 0.1, dict[int, float]()
    for level, points, lines, left_out in blocks:
        left = 0.12 + _STEP * min(level + 1, 9)
        middle = top + _PITCH / 2
        if level - 1 in trunks:
            start = trunks[level - 1]
            trunk = left - _STEP
            axes.plot([trunk, trunk, left - 0.05], [start, middle, middle], color=PALE, lw=1.2)
        axes.plot(
            left, middle, "o", ms=4, color=GREY if left_out else BLUE, alpha=0.6 if left_out else 1
        )
        trunks = {known: at for known, at in trunks.items() if known < level} | {level: middle}
        color = GREY if left_out else INK
        for place, line in enumerate(lines):
            axes.text(
                left + 0.1,
                top + _PITCH * (place + 0.5),
                line,
                va="center",
                fontsize=9 if level >= 0 else 10,  # one font: each makes the PDF heavier
                color=color,
            )
        if points is not None:
            axes.text(
                WIDTH - 0.05,
                middle,
                number(points),
                va="center",
                ha="right",
                fontsize=9,
                color=GREY,
            )
        top += _PITCH * len(lines) + 0.1
    return sheet


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
