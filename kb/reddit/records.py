"""One record of Reddit, a post, a comment or a stub, live or from a dump → a plain row."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Iterable, Iterator
from datetime import UTC, datetime
from typing import Any

import msgspec

from kb.core.errors import DamagedData
from kb.core.profile.reddit import Links
from kb.reddit import entities, fields, plain, tree
from kb.reddit.dumps import LATEST, retrieved
from kb.reddit.types import is_crosspost, link_classifier, poll_options, post_type, removal
from kb.schema.decode import holdable

MARKS = READ, OPEN = "read", "open"  # states of rows that are no things: see `marked`

Row = dict[str, Any]


class RecordReader:
    """Reads the envelopes of one kind into plain rows."""

    def __init__(self, kind: str, links: Links) -> None:
        self._kind = kind
        self._live = kind != "dumps"
        self._classify: Callable[[str], str] = link_classifier(links)

    def envelope(self, line: bytes, *, marks: bool = False) -> list[Row]:
        """The rows of one line, with `marks` those too. Raises DamagedData when it is no
        envelope.
        """
        try:
            envelope = msgspec.json.decode(line)
        except (msgspec.DecodeError, UnicodeDecodeError):
            try:
                envelope = holdable(json.loads(line))  # lone surrogates, which Arrow can't hold
            except ValueError as error:
                raise DamagedData(f"a raw line is no envelope: {error}") from None
        fetched_at, params, status = (
            envelope["fetched_at"],
            envelope["request"]["params"],
            envelope["status"],
        )
        things = list(tree.things(envelope["response"])) if status == 200 else []
        about = about_of(params)
        found = [row for thing in things for row in self.of_thing(thing, about)]
        if self._kind == "listings":
            # A crawl of a span of time leaves out what its listings show of other times.
            found = [
                row
                for row in found
                if not tree.outside(
                    row.get("created_utc"), params.get("since"), params.get("until")
                )
            ]
        known = {row["fullname"] for row in found}
        asked = asked_for(self._kind, params, status)
        found += [row_of(name, post, "missing") for name, post in asked if name not in known]
        if marks:
            found += marked(self._kind, things, params, status)
        return self.told(found, fetched_at, self.dump(envelope["request"]["endpoint"], params))

    def dump(self, endpoint: str, params: dict[str, Any]) -> str:
        """Where a record of a dump stands; empty for live answers."""
        return "" if self._live else f"{endpoint}/{params.get('offset', 0):020d}"

    def told(self, found: list[Row], fetched_at: str | None, dump: str) -> list[Row]:
        """The rows with what the envelope says of all of them."""
        for row in found:
            # A dump's envelope holds records that were read at different times; each says it
            # itself, or nobody knows.
            row["fetched_at"] = fetched_at if self._live else row.pop("retrieved", None)
            row["live"], row["dump"] = self._live, dump
        return found

    def of_thing(self, thing: tree.Thing, about: str) -> Iterator[Row]:
        """The rows of a post, a comment or a stub; `about`: the post that stubs are of."""
        kind, data = thing
        if kind == tree.POST:
            yield self.post(data)
        elif kind == tree.COMMENT:
            yield self.comment(data)
        else:
            yield from (row_of(f"t1_{key}", about, "stub") for key in tree.stub_ids(data))

    def post(self, data: dict[str, Any]) -> Row:
        """The row of a post (a submission's fields of any year)."""
        if not self._live:
            data = entities.resolve(data)
        row, key = _identified("t3", data)
        row["post_id"] = key
        kind, link_kind, url = post_type(data, self._classify)
        row |= {
            "type": kind,
            "link_kind": link_kind,
            "source_url": url,
            "is_crosspost": is_crosspost(data),
            "poll_options": poll_options(data),
            "over_18": fields.flag(row, data, "over_18"),
            "title": fields.text(row, data, "title", needed=True),
            "text": fields.text(row, data, "selftext") or None,
            "num_comments": fields.integer(row, data, "num_comments"),
            "upvote_ratio": fields.ratio(row, data),
        }
        return _common(row, data)

    def comment(self, data: dict[str, Any]) -> Row:
        """The row of a comment."""
        if not self._live:
            data = entities.resolve(data)
        row, _ = _identified("t1", data)
        row["post_id"] = tree.bare(data.get("link_id"))
        parent = data.get("parent_id")
        if not isinstance(parent, str) or not parent.startswith(("t1_", "t3_")):
            # Some dump years give the parent of a comment as a number or leave it out.
            row["found"].append(
                (
                    "parent_id",
                    "absent" if parent is None else "malformed",
                    None if parent is None else str(parent),
                )
            )
            parent = None
        row |= {"parent_id": parent, "text": fields.text(row, data, "body", needed=True)}
        return _common(row, data)


def asked_for(kind: str, params: dict[str, Any], status: int) -> list[tuple[str, str]]:
    """(full name, bare post id) of what a request named, for telling what is missing.

    A post's page that answers 404 or 410 means that the post is gone.
    """
    if kind == "info" and status == 200:
        names = [name for name in str(params.get("id", "")).split(",") if name]
        posts = params.get("posts") or []
        return [
            (
                name,
                tree.bare(name) if name.startswith("t3_") else (posts[n] if n < len(posts) else ""),
            )
            for n, name in enumerate(names)
        ]
    if kind == "morechildren" and status == 200:
        post = tree.bare(params.get("link_id"))
        return [(f"t1_{key}", post) for key in str(params.get("children", "")).split(",") if key]
    if (
        kind == "comments"
        and status in (404, 410)
        and "comment" not in params
        and params.get("article")
    ):
        return [(f"t3_{params['article']}", str(params["article"]))]
    return []


def about_of(params: dict[str, Any]) -> str:
    """The post that an answer is of: stubs don't say it, the request does."""
    return params.get("article") or tree.bare(params.get("link_id"))


def marked(
    kind: str, things: Iterable[tree.Thing], params: dict[str, Any], status: int
) -> Iterator[Row]:
    """Rows that say which parts of a tree are known: `read` the page of a post or of a comment's
    thread, `open` the comment whose replies are behind "continue this thread".
    """
    post = str(params.get("article") or tree.bare(params.get("link_id")))
    if kind == "comments" and post and status in (200, 404, 410):  # what is gone has nothing unread
        comment = params.get("comment")
        yield row_of(f"t1_{comment}" if comment else f"t3_{post}", post, READ)
    if kind not in ("comments", "morechildren") or status != 200:
        return
    for thing in things:
        if thing.kind != "more" or not tree.is_continuation(thing.data):
            continue
        if thing.data["parent_id"].startswith("t1_"):
            yield row_of(thing.data["parent_id"], post, OPEN)


def row_of(fullname: str, post: str, state: str) -> Row:
    """A row without values; `found` are the problems of its fields."""
    return {"fullname": fullname, "post_id": post, "state": state, "found": []}


def _identified(kind: str, data: dict[str, Any]) -> tuple[Row, str]:
    """A row under the thing's id. One without an id can't be told from others: it gets a made-up
    key and is rejected.
    """
    key = data.get("id")
    if isinstance(key, str) and key:
        return row_of(f"{kind}_{key}", "", "there"), key
    made = (
        "unknown-"
        + hashlib.sha256(json.dumps(data, sort_keys=True, default=str).encode()).hexdigest()[:16]
    )
    row = row_of(f"{kind}_{made}", "", "unknown")
    row["found"].append(
        ("state", "malformed" if key is not None else "absent", None if key is None else str(key))
    )
    return row, made


def _common(row: Row, data: dict[str, Any]) -> Row:
    gone = removal(data)
    author = data.get("author")
    row["retrieved"] = _retrieved(data)
    row |= {
        "score": fields.integer(row, data, "score"),
        "created_utc": fields.integer(row, data, "created_utc"),
        "author_hash": author if isinstance(author, str) and author not in plain.NOBODY else None,
        "gone": gone[0] if gone else None,
        "gone_value": gone[1] if gone else None,
    }
    if row["created_utc"] is not None and not 0 <= row["created_utc"] < LATEST:
        row["found"].append(("created_utc", "malformed", str(data.get("created_utc"))))
        row["created_utc"] = None
    return row


def _retrieved(data: dict[str, Any]) -> str | None:
    at = retrieved(data)
    return None if at is None else datetime.fromtimestamp(at, UTC).strftime("%Y-%m-%dT%H:%M:%SZ")
