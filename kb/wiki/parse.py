"""Raw answers of the wiki → rows: what it says of pages, what became of showing them, pictures, the site.

A bad value of the wiki's own answers never raises: it is null and named in `problems`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from typing import Any
from urllib.parse import urljoin

import pyarrow as pa

from kb.schema.coerce import shown, times
from kb.schema.decode import problems
from kb.store import rawlog
from kb.store.rawlog import Envelope
from kb.wiki import answers

ROWS = 8_192
TIMES = ("fetched_at", "revision_timestamp")

Row = dict[str, Any]


def pages(lines: Iterable[bytes]) -> Iterator[pa.Table]:
    """Answers about pages → a row a page id that they name and a row a title that was asked for.

    Columns: `of` ("page", "title"), `name` (the id as text, or the title), `state` ("there", "missing",
    "invalid", "redirect", "special", "interwiki", "unanswered"), `answered` (false for the last), `echo`
    (true for the title of a page that is there: it says no more than the page's own row), `of_page`
    (the id as text of the page that bears a title), and of a page that is there `page_id`, `title`,
    `url`, `revision_id`, `revision_timestamp`, `problems`. Raises DamagedData.
    """
    return _rows(lines, _pages, "pages")


def renders(lines: Iterable[bytes]) -> Iterator[pa.Table]:
    """What became of showing pages: `page_id`, `captured`, `revision_id`, and for a captured one `title`, `folder`
    and `files` (addresses of its pictures), else `outcome`, `reason`, `value`, `url`. Raises DamagedData."""
    return _rows(lines, _render, "renders")


def files(lines: Iterable[bytes]) -> Iterator[pa.Table]:
    """Picture files by `key` (address): where and what they are, all null when not stored. Raises DamagedData."""
    return _rows(lines, _file, "files")


def site(lines: Iterable[bytes]) -> Iterator[pa.Table]:
    """The wiki's description of itself: `server`, `script`, `license_url`, `license_text`. Raises DamagedData."""
    return _rows(lines, _site, "site")


def nothing(lines: Iterable[bytes]) -> Iterator[pa.Table]:
    """No rows of answers that only the crawl needs: they are looked through for unknown keys and cut-off files."""
    for _ in lines:
        pass
    return iter(())


def schema(kind: str) -> pa.Schema:
    """Columns of a kind's rows."""

    text, number, flag, texts = pa.string(), pa.int64(), pa.bool_(), pa.list_(pa.string())
    columns = {
        "pages": {
            "of": text,
            "name": text,
            "state": text,
            "answered": flag,
            "echo": flag,
            "of_page": text,
            "page_id": number,
            "title": text,
            "url": text,
            "revision_id": number,
            "revision_timestamp": pa.timestamp("us", "UTC"),
            "problems": pa.list_(pa.struct([("column", text), ("reason", text), ("value", text)])),
        },
        "renders": {
            "page_id": number,
            "captured": flag,
            "revision_id": number,
            "title": text,
            "folder": text,
            "files": texts,
            "outcome": text,
            "reason": text,
            "value": text,
            "url": text,
        },
        "files": {
            "key": text,
            "url": text,
            "path": text,
            "sha256": text,
            "media_type": text,
            "width": number,
            "height": number,
            "license": text,
            "frames": pa.list_(number),
        },
        "site": {"server": text, "script": text, "license_url": text, "license_text": text},
    }
    return pa.schema([*columns[kind].items(), ("fetched_at", pa.timestamp("us", "UTC"))])


def _rows(
    lines: Iterable[bytes], read: Callable[[Envelope], Iterator[Row]], kind: str
) -> Iterator[pa.Table]:
    waiting: list[Row] = []
    for line in lines:
        envelope = rawlog.decode(line)
        waiting += ({**row, "fetched_at": envelope.fetched_at} for row in read(envelope))
        if len(waiting) >= ROWS:
            yield _table(waiting, kind)
            waiting = []
    if waiting:
        yield _table(waiting, kind)


def _table(rows: list[Row], kind: str) -> pa.Table:

    found = {number: list(row.get("found", ())) for number, row in enumerate(rows)}
    columns = {}
    for field in schema(kind):
        values = [row.get(field.name) for row in rows]
        if field.name in TIMES:
            columns[field.name], bad = times(values)
            for number, value in bad:
                found[number].append((field.name, "malformed", value))
        elif field.name == "problems":
            columns[field.name] = problems(
                {number: odd for number, odd in found.items() if odd}, len(rows)
            ).cast(field.type)
        else:
            columns[field.name] = pa.array(values, field.type)
    return pa.table(columns, schema=schema(kind))


def _pages(envelope: Envelope) -> Iterator[Row]:
    params, query = envelope.request.params, envelope.response.get("query", {})
    by_title = params.keys().isdisjoint(("pageids", "revids"))
    said = set()
    for page in query.get("pages", []):
        key, title, state = page.get("pageid"), page.get("title"), answers.state(page)
        row: Row = {"state": state, "answered": state != "unanswered"}
        said.add(title)
        if title and by_title:
            yield row | {
                "of": "title",
                "name": title,
                "echo": state == "there",
                "of_page": str(key) if key else None,
            }
        if key:
            row |= {"of": "page", "name": str(key), "echo": False, "found": []}
            if state == "there":
                revision = page["revisions"][0]
                row |= {
                    "page_id": _number(row, "page_id", key),
                    "title": _text(row, "title", title),
                    "url": _text(row, "url", page.get("fullurl")),
                    "revision_id": _number(row, "revision_id", revision.get("revid")),
                    "revision_timestamp": revision.get("timestamp"),
                }
            yield row
    names, elsewhere = answers.renamed(query), answers.elsewhere(query)
    for name in answers.asked(params):
        title = names.get(name, name)
        state = "interwiki" if title in elsewhere else "there" if title in said else "unanswered"
        if (
            title not in said or title != name
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
    names = ("url", "path", "sha256", "media_type", "width", "height", "license", "frames")
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


def _text(row: Row, name: str, value: Any) -> str | None:
    if value is None or isinstance(value, str):
        return value
    row["found"].append((name, "malformed", shown(value)))
    return None


def _number(row: Row, name: str, value: Any) -> int | None:
    if value is None or (isinstance(value, int) and not isinstance(value, bool)):
        return value
    row["found"].append((name, "malformed", shown(value)))
    return None
