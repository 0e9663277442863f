"""Video-text pairs as cards: the text with its keyword, and how good the pair is."""

from __future__ import annotations

import re
import shlex
from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any, NamedTuple
from urllib.parse import urlencode

import duckdb

from kb.core.errors import UsageError
from kb.core.sources import SOURCES, made_of
from kb.explore.conditions import (
    MOST,
    TESTS,
    Condition,
    conditions,
    fields,
    sql_of,
)
from kb.explore.tables import CurrentTables, page_number, quoted
from kb.pairs.pair_selection import FIGURES, SCORES, asking
from kb.store.tables.reading import text_literal

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
    without a text; `watch` the clip at the service, `here` its place on the video's page, `cluster`
    the page of those that say nearly the same, "" without any.
    """

    pair_id: str
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
    cluster: str


@dataclass(frozen=True)
class PairsPage:
    """Pairs in the order of video and time, or of a column. `where` is their condition as a draw
    takes it; `given` are the fields of the address, and `filtered` the columns that it may name.
    """

    given: dict[str, str]
    page: int
    total: int
    pairs: list[PairCard]
    keywords: list[tuple[str, int]]
    kinds: list[str]
    where: str = ""
    conditions: list[Condition] = field(default_factory=list)
    filtered: list[str] = field(default_factory=list)
    tests: tuple[str, ...] = TESTS
    most_conditions: int = MOST

    @property
    def keyword(self) -> str:
        """The keyword that is asked for, "" for any."""
        return self.given.get("keyword", "")

    @property
    def kind(self) -> str:
        """The kind of keyword that is asked for, "" for any."""
        return self.given.get("kind", "")

    @property
    def cluster(self) -> str:
        """The pair whose near duplicates are asked for, "" for any pairs."""
        return self.given.get("cluster", "")

    @property
    def sort(self) -> str:
        """The column that orders the pairs, "" for their place."""
        return self.given.get("sort", "")

    @property
    def descending(self) -> bool:
        """Whether the largest comes first."""
        return bool(self.given.get("descending"))

    @property
    def pages(self) -> int:
        """How many there are."""
        return max(1, min(_LAST, -(-self.total // ON_A_PAGE)))

    @property
    def option(self) -> str:
        """The condition as an option of a command, for a shell."""
        is_plain = not set('"$`\\!') & set(self.where)
        return "--where " + (f'"{self.where}"' if is_plain else shlex.quote(self.where))

    @property
    def judged(self) -> str:
        """The address at which these pairs are judged."""
        filters = {name: v for name, v in self.given.items() if name not in ("sort", "descending")}
        return f"/judge?{urlencode({'what': 'pairs'} | filters)}"

    def address(self, page: int) -> str:
        """The address of another page of the same pairs."""
        return f"/pairs?{urlencode(self.given | {'page': page})}"


def read(tables: CurrentTables, language: str, query: Mapping[str, str]) -> PairsPage:
    """The pairs that an address asks for; texts in another `language` are marked.

    Raises UsageError, DamagedData.
    """
    page, given = page_number(query, _LAST), fields_of(query)
    if "pairs" not in tables:
        return PairsPage(given, 1, 0, [], [], [])
    full, kinds = tables.view("pairs").full, columns_of(tables)
    where = where_of(query, kinds)
    order = "video_id, clip_start_s, pair_id"
    if sort := given.get("sort"):
        if sort not in kinds:
            raise UsageError(f"unknown column {sort!r}")
        order = f"{quoted(sort)}{' DESC' if given.get('descending') else ''} NULLS LAST, {order}"
    asked = asking(tables.catalog, where=_named(where, sort)) if where or sort else ""
    with tables.asked(*_tables(tables)) as con:
        keywords = con.execute(
            f"SELECT keyword, count(*) AS n FROM {full} GROUP BY 1 ORDER BY n DESC, 1"
        ).fetchall()
        found = con.execute(f"SELECT DISTINCT keyword_kind::VARCHAR FROM {full} ORDER BY 1")
        names = [kind for (kind,) in found.fetchall()]
        rows = f"({asked})" if asked else full
        total = con.execute(f"SELECT count(*) FROM {rows}").fetchall()[0][0]
        ids = con.execute(
            f"SELECT pair_id FROM {rows} ORDER BY {order}"
            f" LIMIT {ON_A_PAGE} OFFSET {(page - 1) * ON_A_PAGE}"
        ).fetchall()
    places = {pair_id: place for place, (pair_id,) in enumerate(ids)}
    shown = cards(tables, language, "pair_id IN (SELECT unnest(?::VARCHAR[]))", [list(places)])
    shown.sort(key=lambda pair: places[pair.pair_id])
    given_conditions = conditions(query)
    return PairsPage(given, page, total, shown, keywords, names, where, given_conditions, [*kinds])


def fields_of(query: Mapping[str, str]) -> dict[str, str]:
    """The fields of an address that say which pairs, in which order."""
    named = {name: query.get(name, "") for name in ("keyword", "kind", "cluster", "sort")}
    named["descending"] = query.get("descending", "") if named["sort"] else ""
    return {name: v for name, v in named.items() if v} | fields(conditions(query))


def where_of(query: Mapping[str, str], kinds: Mapping[str, str]) -> str:
    """The condition of an address, as `kb pairs draw --where` takes it; "" for all pairs. Raises
    UsageError.
    """
    parts = []
    if keyword := query.get("keyword"):
        parts.append(f"lower(keyword) = {text_literal(keyword.lower())}")
    if kind := query.get("kind"):
        parts.append(f"keyword_kind = {text_literal(kind)}")
    if cluster := query.get("cluster"):
        parts.append(f"{text_literal(cluster)} IN (pair_id, duplicate_of)")
    return " AND ".join([*parts, *sql_of(conditions(query), kinds)])


def columns_of(tables: CurrentTables) -> dict[str, str]:
    """The columns of all that is known of pairs, and DuckDB's types of them. Raises DamagedData."""
    with tables.asked(*_tables(tables)) as con:
        every = {
            name
            for table in _tables(tables)[1:]
            for name, *_ in con.sql(f"DESCRIBE {tables.view(table).full}").fetchall()
        }
        named = " OR ".join(f"{name} IS NULL" for name in sorted(every & {*SCORES, *FIGURES}))
        described = con.sql(f"DESCRIBE {asking(tables.catalog, where=named)}").fetchall()
    return {name: kind for name, kind, *_ in described}


def _named(where: str, sort: str | None) -> str:
    """The condition, which names the column that pairs are sorted by as well."""
    return f"({where or 'true'}) AND ({sort} IS NULL OR true)" if sort else where


def _tables(tables: CurrentTables) -> list[str]:
    """What is known of pairs: the tables of pairs, figures of films, and labels."""
    others = sorted(name for name in tables.names if name.startswith("pairs_"))
    return ["pairs", *others, *(name for name in ("film_figures", "labels") if name in tables)]


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
        about_it = quality.get(key, [{}])[0]
        place = {"ref": f"{VIDEOS}:{pair['video_id']}@{second}", "words": pair["keyword"]}
        made.append(
            PairCard(
                key,
                pair["keyword"],
                pair["keyword_kind"],
                known or pair["video_id"],
                marked_pieces(pair),
                pair["clip_start_s"],
                pair["clip_end_s"],
                f"{SOURCES[VIDEOS].url_of(pair['video_id'])}&t={second}s",
                f"/document?{urlencode(place)}#here",
                list(_marks(pair, about_it, language)),
                [score for given_scores in scores.get(key, ()) for score in _scores(given_scores)],
                _answers(labels.get(key, ())),
                _cluster(key, about_it),
            )
        )
    return made


def _cluster(pair_id: str, quality: Mapping[str, Any]) -> str:
    first = quality.get("duplicate_of") or pair_id
    return f"/pairs?{urlencode({'cluster': first})}" if quality.get("cluster_size", 1) > 1 else ""


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
            "verb" if verb else "no verb near keyword",
            "Whether a verb of the word list stands within five words of the keyword",
            warns=not verb,
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
