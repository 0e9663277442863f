"""Questions that a release answers, asked of its rows for the card."""

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any, NamedTuple

from duckdb import DuckDBPyConnection

from kb.artifacts.release_folder import ReleaseFolder
from kb.artifacts.table_catalog import view_name
from kb.schema.tables import tables
from kb.store.tables.reading import scan


class CardAnswer(NamedTuple):
    """A question that a query answers, and its rows, the first with the names of the columns."""

    question: str
    query: str
    rows: Sequence[Sequence[str]]


def ask(
    con: DuckDBPyConnection, questions: Mapping[str, str], folders: Iterable[ReleaseFolder]
) -> Iterator[CardAnswer]:
    """The questions whose queries find rows in these folders, with what they find; a query names
    tables as `kb query` does. Those of a folder that is not there are left out.
    """
    there = set[str]()
    for folder in folders:
        for part in folder.parts:
            there.add(view := view_name(part.table))
            con.execute(f"CREATE OR REPLACE TEMP VIEW {view} AS SELECT * FROM {scan(part.shards)}")
    absent = {view_name(declared) for declared in tables().values()} - there
    for question, query in questions.items():
        if absent.intersection(re.findall(r"\w+", query)):
            continue
        answer = con.execute(query)
        if rows := answer.fetchall():
            names = [name for name, *_ in answer.description]
            yield CardAnswer(question, query, [names, *([*map(_shown, row)] for row in rows)])


def _shown(value: Any) -> str:
    return ", ".join(map(str, value)) if isinstance(value, list) else str(value)
