"""Decodes raw answers of the wiki to rows (pages, captures, image files, the site), and joins the
newest of them to the pages that the filters judge.

Bad values in the wiki's answers never raise: they are null and listed in `problems`.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from functools import cache, partial
from typing import Any
from urllib.parse import urljoin

import pyarrow as pa
import pyarrow.compute as pc

from kb.schema import raw
from kb.schema.coerce import Bad, coerce, times
from kb.schema.decode import in_batches, problems
from kb.schema.tables import Column, table
from kb.store.rawlog import rawlog
from kb.store.rawlog.rawlog import Envelope
from kb.store.tables.partition import RawKind
from kb.wiki import media_urls
from kb.wiki.parse import answers

ROWS = 8_192
NAMES = ("redirects", "categories")  # lists of titles in what the wiki says of a page
FILE_COLUMNS = ("path", "sha256", "media_type", "width", "height", "license")  # of wiki/images

Row = dict[str, Any]


def rows(kind: str, lines: Iterable[bytes]) -> Iterator[pa.Table]:
    """Raw answers of a kind as tables with the columns of `schema`. Raises DamagedData.

    Answers that only the crawl needs have no rows.
    """
    for batch in in_batches(_rows_of(kind, lines), ROWS):
        yield _table(batch, kind)


def _rows_of(kind: str, lines: Iterable[bytes]) -> Iterator[Row]:
    read = {"pages": _pages, "renders": _render, "files": _file, "site": _site}.get(kind)
    for line in lines:
        if read is not None:
            envelope = rawlog.decode(line)
            yield from ({**row, "fetched_at": envelope.fetched_at} for row in read(envelope))


@cache
def _declared() -> dict[str, tuple[Column, list[str | int], dict[str, Any]]]:
    """Columns of wiki/pages that come from the wiki's answer: each with its path there, and what
    schemas/raw says of the value."""
    declared = {}
    for column in table("wiki/pages").columns:
        if column.source.kind == "pages":
            path = column.source.path
            steps = re.findall(r"[^.\[\]]+", path.removeprefix("query.pages[]."))
            places = [int(step) if step.isdigit() else step for step in steps]
            declared[column.name] = (column, places, raw.at("wiki/pages", path) or {})
    return declared


def schema(kind: str) -> pa.Schema:
    """Columns of a kind's rows: those of the tables as declared, and what only stages read.

    pages: a row a page id in an answer and a row a requested title, by `of` ("page", "title") and
        `name` (the id as text, or the title). `state` is as kb.wiki.parse.answers names it, or
        "interwiki"; `answered` is false for "unanswered"; `echo` marks titles of pages that are
        there, which say no more than the page's own row; `of_page` is the id of the page with
        that title; `redirects` and `categories` are titles.
    renders: a capture, or why there is none (`outcome`, `reason`, `value`, `url`); `files` are
        addresses of its images.
    files: image files by `key` (address); all other columns are null when it is not stored.
    site: the wiki's description of itself.
    """
    text, flag = pa.string(), pa.bool_()
    problem = pa.struct([("column", text), ("reason", text), ("value", text)])
    columns: dict[str, dict[str, pa.DataType]] = {
        "pages": {
            "of": text,
            "name": text,
            "state": text,
            "answered": flag,
            "echo": flag,
            "of_page": text,
            **_types("wiki/pages", *_declared()),
            **dict.fromkeys(NAMES, pa.list_(text)),
            "problems": pa.list_(problem),
        },
        "renders": {
            **_types("wiki/pages", "page_id", "revision_id", "title", "url"),
            "captured": flag,
            "settled": flag,
            "folder": text,
            "files": pa.list_(text),
            "outcome": text,
            "reason": text,
            "value": text,
        },
        "files": {
            **_types("wiki/images", *FILE_COLUMNS),
            "key": text,
            "url": text,
            "frames": pa.list_(pa.int64()),
        },
        "site": {"server": text, "script": text, "license_url": text, "license_text": text},
    }
    return pa.schema([*columns[kind].items(), *_types("wiki/pages", "fetched_at").items()])


def _types(name: str, *columns: str) -> dict[str, pa.DataType]:
    return {column: table(name).column(column).parsed.arrow() for column in columns}


def _table(rows: list[Row], kind: str) -> pa.Table:
    made = schema(kind)
    faults: dict[int, list[tuple[str, str, str | None]]] = {}
    declared = _declared() if kind == "pages" else {}
    columns: dict[str, pa.Array[Any]] = {}
    for field in made:
        values = [row.get(field.name) for row in rows]
        bad: Bad = []
        if field.name in declared:
            column, _, raw_schema = declared[field.name]
            columns[field.name], bad = coerce(values, column.parsed, raw_schema)
        elif field.name == "fetched_at":
            columns[field.name], bad = times(values)
        elif field.name != "problems":
            columns[field.name] = pa.array(values, field.type)
        for number, value in bad:
            faults.setdefault(number, []).append((field.name, "malformed", value))
    if "problems" in made.names:
        columns["problems"] = problems(faults, len(rows)).cast(made.field("problems").type)
    return pa.table(columns, schema=made)


def _pages(envelope: Envelope) -> Iterator[Row]:
    params, query = envelope.request.params, envelope.response.get("query", {})
    by_title = params.keys().isdisjoint(("pageids", "revids"))
    answered_titles = set()
    for page in query.get("pages", []):
        key, title, state = page.get("pageid"), page.get("title"), answers.state(page)
        row: Row = {"state": state, "answered": state != "unanswered"}
        answered_titles.add(title)
        if title and by_title:
            yield row | {
                "of": "title",
                "name": title,
                "echo": state == "there",
                "of_page": str(key) if key else None,
            }
        if key:
            row |= {"of": "page", "name": str(key), "echo": False}
            if state == "there":
                row |= {name: _at(page, path) for name, (_, path, _) in _declared().items()}
                row |= {name: answers.titles(page, name) for name in NAMES}
            yield row
    names, elsewhere = answers.renamed(query), answers.elsewhere(query)
    for name in answers.asked(params):
        title = names.get(name, name)
        state = (
            "interwiki"
            if title in elsewhere
            else "there"
            if title in answered_titles
            else "unanswered"
        )
        if (
            title not in answered_titles or title != name
        ):  # what is there under another title has its answer under that one
            yield {
                "of": "title",
                "name": name,
                "state": state,
                "answered": state != "unanswered",
                "echo": state == "there",
            }


def _render(envelope: Envelope) -> Iterator[Row]:
    answer = envelope.response
    row = {"page_id": int(answer["page_id"]), "captured": answer["outcome"] == "captured"}
    if row["captured"]:
        files = [file["key"] for file in answer["files"]]
        yield row | {
            "revision_id": int(answer["revision_id"]),
            "title": answer["title"],
            "folder": answer["folder"],
            "settled": answer.get("settled"),
            "files": files,
        }
    else:
        value = answer.get("value")
        yield row | {
            "revision_id": answer.get("wanted_revision"),
            "title": "",
            "outcome": answer["outcome"],
            "url": answer["url"],
            "reason": answer["reason"],
            "value": None if value is None else str(value),
        }


def _file(envelope: Envelope) -> Iterator[Row]:
    answer = envelope.response
    names = ("url", "frames", *FILE_COLUMNS)
    stored = answer["outcome"] == "stored"
    yield {"key": answer["key"], **({name: answer.get(name) for name in names} if stored else {})}


def _site(envelope: Envelope) -> Iterator[Row]:
    query = envelope.response.get("query", {})
    general, rights = query.get("general", {}), query.get("rightsinfo", {})
    # "//host" has the scheme of the API's own address.
    server = urljoin(envelope.request.endpoint, general.get("server") or "/").rstrip("/")
    yield {
        "server": server,
        "script": general.get("script"),
        "license_url": rights.get("url"),
        "license_text": rights.get("text"),
    }


def _at(value: Any, path: list[str | int]) -> Any:
    """What stands at a path, None where nothing does."""
    for step in path:
        if isinstance(step, int):
            value = value[step] if isinstance(value, list) and step < len(value) else None
        else:
            value = value.get(step) if isinstance(value, dict) else None
    return value


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
KINDS = {kind: RawKind(partial(rows, kind), **keys) for kind, keys in _KEYS.items()}
# Columns that the stages read and the table has not.
HELPERS = (
    "key",
    "state",
    "of_page",
    "missing",
    "captured",
    "robots",
    "render",
    "failed",
    "said",
    "folder",
    "text",
    *NAMES,
)


def assemble(newest: dict[str, pa.Table], url: str) -> dict[str, Any]:
    """Pages and titles of one bucket as rows of wiki/pages, and the image files that they name.

    A page is captured when its newest revision was shown under its newest title. Adds `key` (the
    id as text, or a title that has no page), `state` (what the wiki says of it), `of_page` (the id
    of a redirect or the like, which has the title and is no page), `missing`, `robots`, `render`
    and `failed` (reasons; what failed is tried again by the next crawl) and `said` (what goes with
    the reason). Pages that are gone by the newest answer are left out: the crawl writes their
    tombstones. `url` is the wiki's root, for raw data without an answer about the site.
    """
    rows = newest.get("pages", schema("pages").empty_table())
    there = pc.equal(rows["state"], "there")
    page = pc.equal(rows["of"], "page")
    rows = rows.filter(
        pc.equal(page, there)
    ).combine_chunks()  # pages that are there, and titles that are not
    absent = pc.not_equal(rows["state"], "there")
    unanswered = pc.equal(rows["state"], "unanswered")
    renders = newest.get("renders", schema("renders").empty_table())
    captures = renders.filter(renders["captured"])
    failures = renders.filter(pc.invert(renders["captured"]))
    shown = _joined(rows, captures, ("page_id", "revision_id", "title"))
    failed = _joined(rows, failures, ("page_id", "revision_id"))
    robots = pc.equal(failed["outcome"], "robots")
    failed_for_now = pc.equal(failed["outcome"], "failed")
    open_ = pc.and_(pc.is_null(shown["folder"]), pc.invert(absent))
    none = pa.scalar(None, pa.string())
    own: dict[str, Any] = {
        "key": rows["name"],
        "state": rows["state"],
        "of_page": rows["of_page"],
        "missing": pc.if_else(pc.and_(absent, pc.invert(unanswered)), rows["state"], none),
        "captured": pc.is_valid(shown["folder"]),
        "robots": pc.if_else(pc.and_(open_, robots), failed["reason"], none),
        "render": pc.if_else(
            pc.and_(open_, pc.invert(pc.or_(robots, failed_for_now))), failed["reason"], none
        ),
        "failed": pc.if_else(pc.and_(open_, failed_for_now), failed["reason"], none),
        "said": pc.if_else(robots, failed["url"], failed["value"]),
        "folder": shown["folder"],
        "settled": shown["settled"],
        "fetched_at": shown["fetched_at"],
        **_of_site(rows["title"], newest.get("site"), url),
    }
    kept = ("page_id", "title", "url", "revision_id", "revision_timestamp", *NAMES, "problems")
    pages = pa.table({**{name: rows[name] for name in kept}, **own})
    return {"wiki/pages": pages, "files": newest.get("files", schema("files").empty_table())}


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
    description = site.to_pylist()[0] if site is not None else dict.fromkeys(schema("site").names)
    script = (description["server"] or url) + (description["script"] or "/index.php")
    license = media_urls.licence(description["license_url"] or None, description["license_text"])
    history = [
        None if title is None else media_urls.history(script, title) for title in titles.to_pylist()
    ]
    return {
        "license": pa.array([license] * len(history), pa.string()),
        "contributors_url": pa.array(history, pa.string()),
    }
