"""Joins the newest answers to the pages that the filters judge."""

from __future__ import annotations

from functools import partial
from typing import Any

import pyarrow as pa
import pyarrow.compute as pc

from kb.store.tables.partition import RawKind
from kb.wiki import media_urls
from kb.wiki.parse import decode

_KEYS: dict[str, dict[str, Any]] = {
    "pages": {
        "key": ("of", "name"),
        "bucket": "name",
        "by": ("answered", "fetched_at"),
        "echo": "echo",
    },
    "renders": {"key": ("page_id", "captured", "revision_id", "title"), "bucket": "page_id"},
    "files": {"key": ("key",), "named_by": ("renders", "files")},
    "site": {"key": ()},
    "titles": {"key": ()},
    "imageinfo": {"key": ()},
}
KINDS = {kind: RawKind(partial(decode.rows, kind), **keys) for kind, keys in _KEYS.items()}
# Columns that the stages read and the table has not.
HELPERS = (
    "key",
    "state",
    "of_page",
    "missing",
    "captured",
    "robots",
    "render",
    "said",
    "folder",
    "text",
)


def assemble(newest: dict[str, pa.Table], url: str) -> dict[str, Any]:
    """Pages and titles of one bucket as rows of wiki/pages, and the image files that they name.

    A page is captured when its newest revision was shown under its newest title. Adds `key` (the
    id as text, or a title that has no page), `state` (what the wiki says of it), `of_page` (the id
    of a redirect or the like, which has the title and is no page), `missing`, `robots` and
    `render` (reasons) and `said` (what goes with the reason). Pages that are gone by the newest
    answer are left out: the crawl writes their tombstones. `url` is the wiki's root, for raw data
    without an answer about the site.
    """
    rows = newest.get("pages", decode.schema("pages").empty_table())
    there = pc.equal(rows["state"], "there")
    page = pc.equal(rows["of"], "page")
    rows = rows.filter(
        pc.equal(page, there)
    ).combine_chunks()  # pages that are there, and titles that are not
    absent = pc.not_equal(rows["state"], "there")
    unanswered = pc.equal(rows["state"], "unanswered")
    renders = newest.get("renders", decode.schema("renders").empty_table())
    captures = renders.filter(renders["captured"])
    failures = renders.filter(pc.invert(renders["captured"]))
    shown = _joined(rows, captures, ("page_id", "revision_id", "title"))
    failed = _joined(rows, failures, ("page_id", "revision_id"))
    robots = pc.equal(failed["outcome"], "robots")
    open_ = pc.and_(pc.is_null(shown["folder"]), pc.invert(absent))
    none = pa.scalar(None, pa.string())
    own: dict[str, Any] = {
        "key": rows["name"],
        "state": rows["state"],
        "of_page": rows["of_page"],
        "missing": pc.if_else(pc.and_(absent, pc.invert(unanswered)), rows["state"], none),
        "captured": pc.is_valid(shown["folder"]),
        "robots": pc.if_else(pc.and_(open_, robots), failed["reason"], none),
        "render": pc.if_else(pc.and_(open_, pc.invert(robots)), failed["reason"], none),
        "said": pc.if_else(robots, failed["url"], failed["value"]),
        "folder": shown["folder"],
        "settled": shown["settled"],
        "fetched_at": shown["fetched_at"],
        **_of_site(rows["title"], newest.get("site"), url),
    }
    kept = ("page_id", "title", "url", "revision_id", "revision_timestamp", "problems")
    pages = pa.table({**{name: rows[name] for name in kept}, **own})
    return {"wiki/pages": pages, "files": newest.get("files", decode.schema("files").empty_table())}


def _joined(rows: pa.Table, other: pa.Table, on: tuple[str, ...]) -> pa.Table:
    """For each row the row of `other` with the same values; nulls where there is none."""

    def keys(table: pa.Table) -> pa.Array[Any]:
        column = pc.binary_join_element_wise(*(table[name].cast(pa.string()) for name in on), "\n")
        return pa.concat_arrays([pa.array([], pa.string()), *column.chunks])

    known = keys(other)
    if not len(known):
        return pa.table({field.name: pa.nulls(rows.num_rows, field.type) for field in other.schema})
    return other.take(pc.index_in(keys(rows), value_set=known, skip_nulls=True)).combine_chunks()


def _of_site(
    titles: pa.ChunkedArray[Any], site: pa.Table | None, url: str
) -> dict[str, pa.Array[Any]]:
    """What every page has of the site's description: its licence, its history's address."""
    description = (
        site.to_pylist()[0] if site is not None else dict.fromkeys(decode.schema("site").names)
    )
    script = (description["server"] or url) + (description["script"] or "/index.php")
    license = media_urls.licence(description["license_url"] or None, description["license_text"])
    history = [
        None if title is None else media_urls.history(script, title) for title in titles.to_pylist()
    ]
    return {
        "license": pa.array([license] * len(history), pa.string()),
        "contributors_url": pa.array(history, pa.string()),
    }
