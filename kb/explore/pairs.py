"""Video-text pairs of a keyword, with what is known of their quality."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any
from urllib.parse import urlencode

import duckdb

from kb.core.errors import UsageError
from kb.explore.tables import CurrentTables

PAGE = 20  # pairs
_LAST = 5_000  # pages


@dataclass(frozen=True)
class PairsPage:
    """Pairs in the order of video and time, each a row of the tables with `url` and `quality`."""

    keyword: str
    kind: str
    page: int
    total: int
    pairs: list[dict[str, Any]]
    keywords: list[tuple[str, int]]
    kinds: list[str]

    @property
    def pages(self) -> int:
        """How many there are."""
        return max(1, min(_LAST, -(-self.total // PAGE)))

    def address(self, page: int) -> str:
        """The address of another page of the same pairs."""
        given = {"keyword": self.keyword, "kind": self.kind, "page": page}
        return f"/pairs?{urlencode({name: value for name, value in given.items() if value})}"


def read(tables: CurrentTables, query: Mapping[str, str]) -> PairsPage:
    """The pairs that an address asks for. Raises UsageError, DamagedData."""
    keyword, kind, page = query.get("keyword", ""), query.get("kind", ""), query.get("page", "1")
    if not page.isascii() or not page.isdigit() or not 1 <= int(page) <= _LAST:
        raise UsageError(f"there is no page {page!r}")
    if "pairs" not in tables:
        return PairsPage(keyword, kind, 1, 0, [], [], [])
    names = ["pairs", *(name for name in ("pairs_quality", "youtube_videos") if name in tables)]
    with tables.asked(*names) as con:
        full = tables.view("pairs").full
        keywords = con.execute(
            f"SELECT keyword, count(*) AS n FROM {full} GROUP BY 1 ORDER BY n DESC, 1"
        ).fetchall()
        kinds = con.execute(f"SELECT DISTINCT keyword_kind::VARCHAR FROM {full} ORDER BY 1")
        given = [one for (one,) in kinds.fetchall()]
        where = "(? = '' OR lower(keyword) = lower(?)) AND (? = '' OR keyword_kind = ?)"
        values = [keyword, keyword, kind, kind]
        total = con.execute(f"SELECT count(*) FROM {full} WHERE {where}", values).fetchall()[0][0]
        found = con.sql(
            f"FROM {full} WHERE {where} ORDER BY video_id, clip_start_s, pair_id"
            f" LIMIT {PAGE} OFFSET {(int(page) - 1) * PAGE}",
            params=values,
        )
        pairs = found.to_arrow_table().to_pylist()
        about = {
            name: _by_key(con, tables.view(name).full, key, pairs)
            for name, key in (("pairs_quality", "pair_id"), ("youtube_videos", "video_id"))
            if name in names
        }
    for pair in pairs:
        start = int(pair["clip_start_s"])
        pair["url"] = f"https://www.youtube.com/watch?v={pair['video_id']}&t={start}s"
        pair["title"] = about.get("youtube_videos", {}).get(pair["video_id"], {}).get("title")
        quality = about.get("pairs_quality", {}).get(pair["pair_id"], {})
        pair["quality"] = {
            name: value
            for name, value in quality.items()
            if name not in ("pair_id", "video_id") and value is not None
        }
    return PairsPage(keyword, kind, int(page), total, pairs, keywords, given)


def _by_key(
    con: duckdb.DuckDBPyConnection, full: str, key: str, pairs: list[dict[str, Any]]
) -> dict[str, dict[str, Any]]:
    """The rows of another table that belong to the pairs of this page."""
    wanted = sorted({pair[key] for pair in pairs})
    query = f"FROM {full} WHERE {key} IN (SELECT unnest(?::VARCHAR[]))"
    found = con.sql(query, params=[wanted])
    return {row[key]: row for row in found.to_arrow_table().to_pylist()}
