"""`about`: what the knowledge base contains, how old it is, and under which licences."""

from collections.abc import Iterator
from typing import Any

from kb.artifacts import index, table_catalog, texts
from kb.artifacts.table_catalog import bare
from kb.core import terminal
from kb.core.context import Run
from kb.core.source import Source
from kb.core.sources import SOURCES
from kb.mcp.untrusted_text import AnswerPart, Fence, cut, fit
from kb.reader.open_tables import OpenTables
from kb.reader.tables import TableView

_LICENCES = 10  # of a source


def run_about(run: Run, size: int) -> str:
    """Sources with dates and licences, the index, the views. Raises DamagedData, UsageError."""
    opened = OpenTables([table_catalog.read(run.root)])
    fence = Fence()
    head = (
        f"{fence.note}\n"
        f"A Lorecrawl knowledge base, profile {run.profile.name}: {run.profile.title}.\n"
        "`search` finds places, `read` shows the surroundings of one, `query` runs SQL (DuckDB)"
        " over the views below; SELECT column_name FROM (DESCRIBE view) lists columns."
    )
    sources = [source for source in SOURCES.values() if source.ref]
    parts = [AnswerPart(_source(opened, one), _licences(opened, one)) for one in sources]
    known = [part for part in parts if part.facts]
    index = AnswerPart("\n".join(["Indexed for `search`:", *_indexed(run)]), "")
    views = [AnswerPart(line, "") for line in _views(opened)]
    return fit(fence, head, [*known, index, *views], _left_out, size)


def _left_out(count: int) -> str:
    return f"{count} more parts were left out: raise max_chars."


def _source(opened: OpenTables, source: Source) -> str:
    noun = source.main
    ranked = opened.ranked(f"{source.name}_{noun}")
    if not ranked:
        return ""
    view, (when, word) = ranked[0].full, source.dated
    row = _row(
        opened,
        f"SELECT count(*) AS n, min({when}) AS first, max({when}) AS last,"
        f" min(fetched_at) AS oldest, max(fetched_at) AS newest FROM {view}",
    )
    return (
        f"{source.name}: {row['n']:,} {noun}, {word}"
        f" from {_day(row['first'])} to {_day(row['last'])},"
        f" fetched from {_day(row['oldest'])} to {_day(row['newest'])} ({view})"
        + (f"; {source.unlicensed}" if source.unlicensed else "")
    )


def _licences(opened: OpenTables, source: Source) -> str:
    ranked = opened.ranked(f"{source.name}_{source.main}")
    if not ranked or source.unlicensed:
        return ""
    sql = f"SELECT license, count(*) AS n FROM {ranked[0].full} GROUP BY 1 ORDER BY 2 DESC, 1"
    rows = opened.rows(sql).to_pylist()
    lines = [
        f"licence {cut(terminal.one_line(row['license'] or 'none given'), 200)}: {row['n']:,}"
        for row in rows[:_LICENCES]
    ]
    return "\n".join([*lines, *([f"and {len(rows) - _LICENCES} more"] * (len(rows) > _LICENCES))])


def _row(opened: OpenTables, sql: str) -> dict[str, Any]:
    return dict(opened.rows(sql).to_pylist()[0])


def _day(when: Any) -> str:
    return when.date().isoformat() if when is not None else "an unknown day"


def _indexed(run: Run) -> Iterator[str]:
    for source in SOURCES:
        if not texts.files(run.root, f"index/{source}"):
            yield f"{source}: no clean texts"
        elif index.is_current(run.root, source):
            known = index.known(run.root, source)
            yield f"{source}: {known.figures['passages'] if known else 0:,} passages"
        else:
            yield f"{source}: indexed by the first search"


def _views(opened: OpenTables) -> Iterator[str]:
    short = {view.full: name for name, view in bare(opened.views).items()}
    for name, one in sorted(opened.named.items()):
        also = f" (also {short[name]})" if name in short else ""
        yield f"view {name}{also}: {TableView(one).count_rows():,} rows. {one.doc}"
