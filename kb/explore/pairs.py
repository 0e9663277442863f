"""Video-text pairs as cards: the text with its keyword, and how good the pair is."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple
from urllib.parse import urlencode

import duckdb

from kb.core.sources import SOURCES, made_of
from kb.explore.tables import CurrentTables, page_number

(VIDEOS,) = made_of("pairs")  # the source of the videos
ON_A_PAGE = 18  # cards: a number that fills rows of two and of three
_LAST = 5_000  # pages
_RECURRING = 0.2  # share of words above which a channel seems to say it in each video
_FAST = 4.0  # words per second that few people speak


class QualityMark(NamedTuple):
    """One figure of a pair as a small mark; `warns` where it speaks against the pair."""

    text: str
    title: str
    warns: bool = False


class PairCard(NamedTuple):
    """A pair for people. `pieces` is the text in pieces of which every second one is the phrase, []
    without a text; `watch` the clip at the service, `here` its place on the video's page.
    """

    keyword: str
    kind: str
    title: str
    pieces: list[str]
    start_s: float
    end_s: float
    watch: str
    here: str
    marks: list[QualityMark]
    scores: list[tuple[str, str]]
    answers: list[str]


@dataclass(frozen=True)
class PairsPage:
    """Pairs in the order of video and time."""

    keyword: str
    kind: str
    page: int
    total: int
    pairs: list[PairCard]
    keywords: list[tuple[str, int]]
    kinds: list[str]

    @property
    def pages(self) -> int:
        """How many there are."""
        return max(1, min(_LAST, -(-self.total // ON_A_PAGE)))

    def address(self, page: int) -> str:
        """The address of another page of the same pairs."""
        given = {"keyword": self.keyword, "kind": self.kind, "page": page}
        return f"/pairs?{urlencode({name: value for name, value in given.items() if value})}"


def read(tables: CurrentTables, language: str, query: Mapping[str, str]) -> PairsPage:
    """The pairs that an address asks for; texts in another `language` are marked.

    Raises UsageError, DamagedData.
    """
    keyword, kind, page = query.get("keyword", ""), query.get("kind", ""), page_number(query, _LAST)
    if "pairs" not in tables:
        return PairsPage(keyword, kind, 1, 0, [], [], [])
    full = tables.view("pairs").full
    with tables.asked("pairs") as con:
        keywords = con.execute(
            f"SELECT keyword, count(*) AS n FROM {full} GROUP BY 1 ORDER BY n DESC, 1"
        ).fetchall()
        kinds = con.execute(f"SELECT DISTINCT keyword_kind::VARCHAR FROM {full} ORDER BY 1")
        given = [kind for (kind,) in kinds.fetchall()]
        where = "(? = '' OR lower(keyword) = lower(?)) AND (? = '' OR keyword_kind = ?)"
        values = [keyword, keyword, kind, kind]
        total = con.execute(f"SELECT count(*) FROM {full} WHERE {where}", values).fetchall()[0][0]
        at = (page - 1) * ON_A_PAGE
    shown = cards(tables, language, where, values, f"LIMIT {ON_A_PAGE} OFFSET {at}")
    return PairsPage(keyword, kind, page, total, shown, keywords, given)


def cards(
    tables: CurrentTables, language: str, where: str, values: list[Any], limit: str = ""
) -> list[PairCard]:
    """The pairs of a condition in the order of video and time, with what other tables say of them.
    Raises DamagedData.
    """
    if "pairs" not in tables:
        return []
    others = ("pairs_quality", "pairs_scores", "labels", f"{VIDEOS}_videos")
    names = ["pairs", *(name for name in others if name in tables)]
    with tables.asked(*names) as con:
        pairs = (
            con.sql(
                f"FROM {tables.view('pairs').full} WHERE {where}"
                f" ORDER BY video_id, clip_start_s, pair_id {limit}",
                params=values,
            )
            .to_arrow_table()
            .to_pylist()
        )

        def about(name: str, key: str, column: str = "") -> dict[str, list[dict[str, Any]]]:
            wanted = sorted({pair[key] for pair in pairs})
            if name not in names:
                return {}
            return _by_key(con, tables.view(name).full, column or key, wanted)

        videos, quality = about(f"{VIDEOS}_videos", "video_id"), about("pairs_quality", "pair_id")
        scores, labels = about("pairs_scores", "pair_id"), about("labels", "pair_id", "item_id")
    made = []
    for pair in pairs:
        key, second = pair["pair_id"], int(pair["clip_start_s"])
        known = videos.get(pair["video_id"], [{}])[0].get("title")
        place = {"ref": f"{VIDEOS}:{pair['video_id']}@{second}", "words": pair["keyword"]}
        made.append(
            PairCard(
                pair["keyword"],
                pair["keyword_kind"],
                known or pair["video_id"],
                marked_pieces(pair),
                pair["clip_start_s"],
                pair["clip_end_s"],
                f"{SOURCES[VIDEOS].url_of(pair['video_id'])}&t={second}s",
                f"/document?{urlencode(place)}#here",
                list(_marks(pair, quality.get(key, [{}])[0], language)),
                [score for given_scores in scores.get(key, ()) for score in _scores(given_scores)],
                _answers(labels.get(key, ())),
            )
        )
    return made


def _by_key(
    con: duckdb.DuckDBPyConnection, full: str, key: str, wanted: list[str]
) -> dict[str, list[dict[str, Any]]]:
    """The rows of another table that belong to the pairs of this page."""
    query = f"FROM {full} WHERE {key} IN (SELECT unnest(?::VARCHAR[]))"
    by_key: dict[str, list[dict[str, Any]]] = {}
    for row in con.sql(query, params=[wanted]).to_arrow_table().to_pylist():
        by_key.setdefault(row[key], []).append(row)
    return by_key


def marked_pieces(pair: Mapping[str, Any]) -> list[str]:
    """The text before the phrase, the phrase, and the text behind it. Where sounds were taken out
    of the text, the phrase's place is not known, and the keyword is looked for.
    """
    text = pair.get("text") or ""
    begin = pair["match_start_char"] - pair["text_start_char"]
    end = begin + pair["match_end_char"] - pair["match_start_char"]
    if len(text) != pair["text_end_char"] - pair["text_start_char"]:
        keyword = re.search(rf"\b{re.escape(pair['keyword'])}\w*", text, re.IGNORECASE)
        begin, end = keyword.span() if keyword else (len(text), len(text))
    return [text[:begin], text[begin:end], text[end:]] if text else []


def _marks(
    pair: Mapping[str, Any], quality: Mapping[str, Any], language: str
) -> Iterable[QualityMark]:
    times = "timed by word" if pair.get("timing") == "word" else "timed by caption"
    yield QualityMark(f"{pair['token_count']} tokens", "CLIP tokens of the text")
    yield QualityMark(
        f"{pair['transcript_kind']}, {times}", "Where the text and its times are from"
    )
    if (spoken := quality.get("language")) is not None:
        yield QualityMark(spoken, "Language", warns=spoken != language)
    if (verb := quality.get("has_verb")) is not None:
        yield QualityMark(
            "verb" if verb else "no verb", "A verb stands near the keyword", warns=not verb
        )
    if (speed := quality.get("words_per_second")) is not None:
        yield QualityMark(f"{speed:.1f} words/s", "Speed of speech", warns=speed > _FAST)
    if (share := quality.get("recurring_share")) is not None:
        yield QualityMark(
            f"{share:.0%} recurs",
            "Share of the words that the channel says in many videos",
            warns=share > _RECURRING,
        )
    if (size := quality.get("cluster_size")) is not None:
        copy = quality.get("duplicate_of") is not None
        text = "unique" if size == 1 else f"{'repeats' if copy else 'first of'} {size}"
        yield QualityMark(text, "Near duplicates in other videos", warns=copy)


def _scores(row: Mapping[str, Any]) -> Iterable[tuple[str, str]]:
    model = str(row["model"]).partition("@")[0]
    yield f"Similarity ({model})", f"{row['similarity']:.3f}"
    if row["margin"] is not None:
        yield "Margin", f"{row['margin']:+.3f}"
    if row["best_offset_s"] is not None:
        yield "Best offset", f"{row['best_offset_s']:+.0f} s"
    if row["static_share"] is not None:
        yield "Static", f"{row['static_share']:.0%}"


def _answers(labels: Iterable[Mapping[str, Any]]) -> list[str]:
    """What people judged: "visible: yes 2, no 1"."""
    by_question: dict[str, Counter[str]] = {}
    for label in labels:
        by_question.setdefault(label["question"], Counter())[str(label["answer"])] += 1
    return [
        f"{question.replace('_', ' ')}: {', '.join(f'{a} {n}' for a, n in counts.most_common())}"
        for question, counts in sorted(by_question.items())
    ]
