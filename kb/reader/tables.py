"""`data.tables`: what is there, by name."""

from __future__ import annotations

import difflib
from collections.abc import Iterator, Mapping

from kb.artifacts.catalog import View, bare
from kb.core.errors import UsageError
from kb.reader import html
from kb.reader.hints import hinted
from kb.reader.rows import TableView


class Tables(Mapping[str, TableView]):
    """Every table by its bare name; `release.youtube_videos` names one of several.

    list(data.tables); data.tables["youtube_videos"]; "clean.reddit_posts" in data.tables

    A bare name is the clean table where there is one, else the released, else the restored one.
    """

    def __init__(self, views: list[View]) -> None:
        self._short = {name: view.full for name, view in sorted(bare(views).items())}
        self._full = {view.full: TableView(view) for view in sorted(views)}

    @hinted
    def __getitem__(self, name: str) -> TableView:
        full = self._short.get(name, name)
        if full in self._full:
            return self._full[full]
        near = difflib.get_close_matches(name, [*self._short, *self._full], 3)
        raise UnknownTable(
            f"no table {name!r} here." + (f" Did you mean {' or '.join(near)}?" if near else ""),
            hint="data.tables lists them",
        )

    def __contains__(self, name: object) -> bool:
        return name in self._short or name in self._full

    def __iter__(self) -> Iterator[str]:
        return iter(self._short)

    def __len__(self) -> int:
        return len(self._short)

    def all(self) -> list[TableView]:
        """Every table, those that a bare name does not reach as well."""
        return list(self._full.values())

    def _repr_html_(self) -> str:
        reached = set(self._short.values())
        lines = [
            (
                one.name.partition(".")[2] if one.name in reached else one.name,
                one.name.partition(".")[0],
                one.count_rows(),
                len(one.schema),
                one.doc,
            )
            for one in self._full.values()
        ]
        return html.rows(["table", "schema", "rows", "columns", "a row is"], lines)

    def __repr__(self) -> str:
        return f"<kb tables: {', '.join(self._short)}>"


class UnknownTable(UsageError, KeyError):
    """A name of no table; a KeyError too, as of any mapping."""

    def __str__(self) -> str:
        return str(self.args[0])
