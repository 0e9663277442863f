"""The topic of a video: a known game label decides, else category and keywords.

MineDojo keeps "the Minecraft category"; the Data API has no such field. The watch page names the
game, so it decides wherever it was read. Without a label a video is on topic when it is in one of
the profile's categories and a profile keyword stands as a whole word in title, tags or description.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import reduce
from typing import Any

import pyarrow as pa

from kb.core import scripts
from kb.core.installation import np, pc
from kb.filters.predicates import (
    PUBLIC,
    Judgement,
    NotTrue,
    Predicate,
    Present,
    malformed,
    nothing,
    rows_passing,
    text,
)
from kb.schema.video_facts import BY_KEYWORDS, BY_LABEL, BY_PROFILE
from kb.store.tables.columns import column
from kb.youtube.section import YouTubeSection

# Where no spaces stand between words, a word begins and ends anywhere.
_EDGE = rf"(?:[^\pL\pN_]|[{scripts.UNSPACED}])"


def whole_words(phrases: Sequence[str]) -> str:
    """An RE2 pattern that finds any of the phrases as whole words,
    whatever their case and spaces.
    """
    return "(?i)" + "|".join(map(_whole, filter(str.strip, phrases)))


def _whole(phrase: str) -> str:
    words = r"\s+".join(re.escape(word) for word in phrase.split())
    first, last = phrase.strip()[0], phrase.strip()[-1]
    before = "" if scripts.is_word(first) else rf"(?:^|{_EDGE})"
    behind = "" if scripts.is_word(last) else rf"(?:$|{_EDGE})"
    return f"{before}{words}{behind}"


@dataclass(frozen=True)
class Topic(Predicate):
    """Rows of the topic, with what showed it in `topic_evidence` (game_label, profile or keywords).

    `gate` are the stages that a video passes before its label is read: as long as the label of
    such a video was not read, its topic is pending (`label`), or failed where reading it failed.
    `game_ids` empty: labels decide nothing. `imported_known`: a video of an imported file is on
    topic unless a label says otherwise.
    """

    game_ids: tuple[str, ...]
    category_ids: tuple[int, ...]
    keywords: tuple[str, ...]
    gate: tuple[Predicate, ...] = field(default=())
    imported_known: bool = False
    stage: str = "topic"

    @property
    def reads(self) -> frozenset[str]:
        own = {
            "category_id",
            "title",
            "tags",
            "description",
            "game_label_id",
            "game_label",
            "transcript_outcome",
            *(("imported",) if self.imported_known else ()),
        }
        return frozenset(own).union(*(predicate.reads for predicate in self.gate))

    def fill(self, rows: pa.Table) -> pa.Table:
        """The rows with `topic_evidence`; null for those that are off topic."""
        named, ours, categorised = self._labels(rows)
        ours, meant = pc.and_(named, ours), self._meant(rows, named)
        candidate = pc.and_(pc.invert(pc.or_(named, meant)), categorised)
        hit = reduce(pc.or_, self._places(rows, candidate).values())
        evidence = pc.case_when(
            pc.make_struct(ours, meant, hit),
            pa.scalar(BY_LABEL),
            pa.scalar(BY_PROFILE),
            pa.scalar(BY_KEYWORDS),
        )
        return rows.append_column("topic_evidence", evidence)

    def judge(self, rows: pa.Table) -> Judgement:
        """`label` (pending or failed), `other_game`, `category`, `keywords`,
        `absent` or `malformed`.
        """
        outcome = column(rows, "transcript_outcome")
        failed = pc.fill_null(pc.equal(outcome, "failed"), False)
        named, _, categorised = self._labels(rows)
        waiting = pc.and_(
            pc.or_(pc.is_null(outcome), failed),
            pc.and_(categorised, pc.invert(pc.or_(named, self._meant(rows, named)))),
        )
        waiting = (
            pc.and_(waiting, rows_passing(self.gate, rows))
            if self.game_ids
            else pc.and_(waiting, False)
        )
        off = pc.is_null(column(rows, "topic_evidence"))
        category = column(rows, "category_id")
        bad = malformed(rows, "category_id")
        lost = pc.if_else(pc.is_valid(bad), "malformed", "absent")
        why = pc.case_when(
            pc.make_struct(
                waiting, pc.invert(off), named, pc.is_null(category), pc.invert(categorised)
            ),
            pa.scalar("label"),
            pa.scalar(None, pa.string()),
            pa.scalar("other_game"),
            lost,
            pa.scalar("category"),
            pa.scalar("keywords"),
        )
        label = pc.coalesce(column(rows, "game_label"), column(rows, "game_label_id"))
        value = pc.case_when(
            pc.make_struct(
                pc.equal(why, "other_game"), pc.equal(why, "malformed"), pc.equal(why, "category")
            ),
            label,
            bad,
            text(category),
            nothing(rows),
        )
        threshold = ", ".join(str(each) for each in self.category_ids)
        return Judgement(
            why,
            value,
            threshold,
            pc.if_else(waiting, pc.if_else(failed, "failed", "pending"), "rejected"),
        )

    def conditions(self, rows: pa.Table) -> tuple[pa.Array[Any], pa.Array[Any]]:
        """Label, category and keyword: what fits and what does not, with the row's value."""
        label = pc.coalesce(column(rows, "game_label"), column(rows, "game_label_id"))
        category = text(column(rows, "category_id"))
        named, ours, categorised = self._labels(rows)
        # A candidate that is off has no keyword anywhere: it was looked for.
        candidate = pc.fill_null(pc.and_(pc.invert(named), categorised), False)
        off = pc.is_null(column(rows, "topic_evidence"))
        places = self._places(rows, pc.and_(off, pc.invert(candidate)))
        keyword = pc.coalesce(
            *(pc.if_else(hit, f"keyword in {name}", None) for name, hit in places.items())
        )
        matched = [
            pc.if_else(pc.and_(named, ours), _with("label", label), None),
            pc.if_else(categorised, _with("category", category), None),
            keyword,
        ]
        unmatched = [
            pc.if_else(pc.and_(named, pc.invert(ours)), _with("label", label), None),
            pc.if_else(categorised, None, pc.fill_null(_with("category", category), "category")),
            pc.if_else(pc.is_valid(keyword), None, "keywords"),
        ]
        return _listed(matched), _listed(unmatched)

    def _labels(self, rows: pa.Table) -> tuple[Any, Any, Any]:
        """Whether a label is known, whether it is the game's, and whether the category fits."""
        label = column(rows, "game_label_id")
        games, categories = (
            pa.array(self.game_ids, pa.string()),
            pa.array(self.category_ids, pa.int64()),
        )
        return (
            pc.and_(pc.is_valid(label), bool(self.game_ids)),
            pc.is_in(label, games),
            pc.is_in(column(rows, "category_id"), categories),
        )

    def _meant(self, rows: pa.Table, named: Any) -> Any:
        """Which rows the profile takes as meant: imported, and without a label."""
        if not self.imported_known:
            return pa.array(np.zeros(rows.num_rows, bool))
        return pc.and_(pc.fill_null(column(rows, "imported"), False), pc.invert(named))

    def _places(self, rows: pa.Table, candidate: pa.Array[Any]) -> dict[str, pa.Array[Any]]:
        """Text → the candidates where a keyword stands in it and in none before it."""
        pattern = whole_words(self.keywords)
        nowhere = pa.array([False] * rows.num_rows, pa.bool_())
        places: dict[str, pa.Array[Any]] = {}
        open_ = candidate
        for name in ("title", "tags", "description"):
            texts = column(rows, name).filter(open_)
            if pa.types.is_list(texts.type):
                texts = pc.binary_join(texts, "\n")
            places[name] = nowhere
            if len(texts):
                hit = pc.fill_null(pc.match_substring_regex(texts, pattern), False)
                places[name] = pc.replace_with_mask(nowhere, open_, hit)
                open_ = pc.and_(open_, pc.invert(places[name]))
        return places


def _with(what: str, values: pa.Array[Any]) -> Any:
    """`category 20`; null where the value is."""
    return pc.binary_join_element_wise(what, values.cast(pa.string()), " ")


def _listed(parts: list[pa.Array[Any]]) -> Any:
    """The parts that are not null, separated by commas; null if there are none."""
    ended = [
        pc.fill_null(pc.binary_join_element_wise(part.cast(pa.string()), ", ", ""), "")
        for part in parts
    ]
    joined = pc.utf8_slice_codeunits(pc.binary_join_element_wise(*ended, ""), 0, -2)
    return pc.if_else(pc.equal(joined, ""), pa.scalar(None, pa.string()), joined)


# A video without one of these counts as missing.
_NEEDED = ("view_count", "duration_s", "width", "height")


class Evidence(Topic):
    """What shows the topic now. It rejects nothing, because released videos were judged before."""

    def fill(self, rows: pa.Table) -> pa.Table:
        """Add `topic_evidence`; "none" where nothing shows the topic any more."""
        rows = super().fill(rows)
        position = rows.column_names.index("topic_evidence")
        shown = pc.fill_null(rows["topic_evidence"], "none")
        return rows.set_column(position, "topic_evidence", shown)

    def judge(self, rows: pa.Table) -> Judgement:
        """All pass."""
        return Judgement(nothing(rows), nothing(rows), None)


def released_stages(section: YouTubeSection) -> tuple[Predicate, ...]:
    """The stages of videos that were released and are read again: what still exists and is still
    public passes.
    """
    return (
        NotTrue("missing", stage="missing", reason="missing"),
        PUBLIC,
        *(Present(column, stage="missing") for column in _NEEDED),
        Evidence(section.game_ids, section.category_ids, section.words),
    )
