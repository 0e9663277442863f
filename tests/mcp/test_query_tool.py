"""`query`: SQL that only reads, within limits."""

import re
from pathlib import Path

from tests.mcp.conftest import Ask
from tests.query.test_statements import ESCAPES


def test_query_reads_the_views_and_nothing_else(ask: Ask, data: Path, tmp_path: Path) -> None:
    assert "\n14,Camel\n" in ask("query", sql="SELECT page_id, title FROM clean.wiki_pages")
    tried = re.compile(r"COPY youtube|temp_directory'\)|arrow|blob", re.IGNORECASE)
    chosen = [sql for sql in ESCAPES if tried.search(sql)]
    assert len(chosen) >= 4
    for sql in [*chosen, "SELECT 1; SELECT 2"]:
        text = ask("query", sql=sql.format(tmp=tmp_path, root=data))
        assert text.error, sql
    assert list(tmp_path.iterdir()) == []


def test_query_is_limited(ask: Ask) -> None:
    text = ask("query", sql="FROM range(1000000)", max_rows=7)
    assert "\n6\n" in text
    assert "\n7\n" not in text
    assert "More rows were left out" in text
    text = ask("query", sql="SELECT repeat('word ', 100000) AS words, 7 AS n", max_chars=1000)
    assert "(cut, 500,000 characters in total)" in text
    assert ",7\n" in text
    text = ask("query", sql="SELECT count(*) FROM range(9999999) a, range(9999999) b"
               " WHERE hash(a.range) % (b.range + 1) = 7", timeout_s=0.5)  # fmt: skip
    assert text.error
    assert "longer than 0.5 s" in text
    text = ask("query", sql="SELECT length(repeat('x', 3000000000))")
    assert text.error
    assert "emory" in text
