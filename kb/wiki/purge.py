"""What of the wiki's raw data must go, and how a page leaves it: answers, captures, pictures."""

from __future__ import annotations

import operator
import re
import shutil
from collections.abc import Collection
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import msgspec

from kb.core.context import Run
from kb.core.verdict import Summary
from kb.crawl import purge as frame
from kb.crawl.session import Session
from kb.store import purge, purge_plan, rawlog, tombstones
from kb.store.frontier import Frontier
from kb.store.inside import is_inside
from kb.store.purge import Place
from kb.store.rawlog import Envelope
from kb.wiki import answers, tables
from kb.wiki.payloads import PAYLOADS
from kb.wiki.reduce import LEFT
from kb.wiki.source import WikiSource
from kb.wiki.titles import Titles, read_names

ROWS = (
    *(
        Place(f"clean/wiki/{name}", f"wiki/{name}", "page_id")
        for name in ("pages", "elements", "cells", "images")
    ),
    *(
        Place(f"clean/wiki/{verdict}", f"shared/{verdict}", "key")
        for verdict in ("rejected", "failed", "pending")
    ),
)


def purge_raw(run: Run, ids: Path | None) -> frame.Keys:
    """Tombstones, raw segments, captured files and frontier; the keys that must leave the rest too.

    `ids` names pages by id, title or address: lines, Parquet with `page_id` or `title`, or
    MineDojo's JSON. `unknown` of what is said are names that nothing here bears (their tombstones
    keep them away), `bad_lines` can be no page. Raises SettingError (exit 2) when the file can't be
    read, before anything is written.
    """
    named = read_names(ids, "--ids", ("page_id", "title")) if ids else Titles([], frozenset(), 0)

    def collect(session: Session) -> frame.Keys:
        known, unknown, bad = _find(named, session.frontier, session.gone)
        found = _gone(session.frontier) | dict.fromkeys([*known, *unknown], "named")
        return frame.Keys(found, {"unknown": len(unknown), "bad_lines": bad} if ids else {})

    def remove(session: Session, keys: frame.Keys) -> None:
        _remove(run.root, session.frontier, keys)

    return frame.purge_raw(run, WikiSource(run), collect, exact=("renders",), remove=remove)


def plan(run: Run, ids: Path | None) -> Summary:
    """What `kb purge wiki` would remove, counted. Changes nothing."""
    named = read_names(ids, "--ids", ("page_id", "title")) if ids else Titles([], frozenset(), 0)
    root = run.root
    with purge_plan.state(root, "wiki", PAYLOADS) as frontier:
        if frontier is None:
            return purge_plan.plan(root, "wiki", {}, lambda kind, envelope, keys: envelope, ())
        known, unknown, bad = _find(named, frontier, tombstones.keys(root, "wiki"))
        keys = {**purge.left_over(root, "wiki"), **_gone(frontier), **dict.fromkeys(known, "named")}
        counts = purge_plan.plan(root, "wiki", keys, _strip(root, frontier, keys), ROWS)
    said = {"unknown": len(unknown), "bad_lines": bad} if ids else {}
    return Summary(counts, **said)


def _gone(frontier: Frontier) -> dict[str, str]:
    return {
        key: str(reason)
        for key, _, reason, _ in frontier.items("pages", "skipped")
        if reason in LEFT
    }


def _find(
    named: Titles, frontier: Frontier, removed: Collection[str]
) -> tuple[set[str], set[str], int]:
    """Keys of named pages that are or were here, names nothing bears, how many can be no page's."""
    pages = {key: page for key, _, _, page in frontier.items("pages")}
    titles = {title: key for key, page in pages.items() for title in page.former}
    titles |= {page.title: key for key, page in pages.items()}
    titles |= {
        title: title
        for key, *_ in frontier.items("info")
        if (title := key.partition(":")[2]) not in titles
    }
    known: set[str] = set()
    unknown: set[str] = set()
    bad = named.bad_lines
    for name in named.names:
        if name in pages or name in named.ids or name in removed:  # a number is an id first
            (known if name in pages or name in removed else unknown).add(name)
        elif held := titles.get(name) or titles.get(name[:1].upper() + name[1:]):
            known.add(held)
        elif re.search(r"[\[\]{}<>#]", name):
            bad += 1
        else:
            unknown.add(name)
    return known, unknown, bad


def _strip(root: Path, frontier: Frontier, keys: Collection[str]) -> Strip:
    return Strip(
        keys,
        {page.title for key, _, _, page in frontier.items("pages") if key in keys}
        | {key for key in keys if not key.isdigit()},
        *_own_files(root, keys),
    )


def _remove(root: Path, frontier: Frontier, keys: Collection[str]) -> None:
    strip = _strip(root, frontier, keys)
    for path in sorted(strip.paths):
        (root / path).unlink(missing_ok=True)
    for key in keys:
        if key.isdigit():
            shutil.rmtree(root / "raw" / "wiki" / "pages" / key, ignore_errors=True)
    purge.rewrite_raw(root, "wiki", keys, strip, frontier)
    frontier.remove("pages", keys)
    frontier.remove("files", strip.files)
    frontier.remove(
        "info", [key for key, *_ in frontier.items("info") if key.partition(":")[2] in strip.titles]
    )


def _own_files(root: Path, keys: Collection[str]) -> tuple[set[str], set[str]]:
    """Pictures that only these pages show: their addresses, and the paths of what was stored."""
    mine: dict[bool, set[str]] = {True: set(), False: set()}
    paths: dict[bool, set[str]] = {True: set(), False: set()}
    for envelope in rawlog.read(root, "wiki", "renders"):
        answer = envelope.response
        if answer["outcome"] != "captured":
            continue
        gone = str(answer["page_id"]) in keys
        mine[gone] |= {file["key"] for file in answer["files"]}
        folder = root / answer["folder"]
        if is_inside(root, answer["folder"]) and (folder / "extraction.json.zst").exists():
            sprites = tables.read_extraction(folder).get("sprites", {})
            paths[gone] |= {f"raw/wiki/images/{name}.png" for name in sprites.values()}
    files = mine[True] - mine[False]
    for envelope in rawlog.read(root, "wiki", "files"):
        answer = envelope.response
        if answer.get("path"):
            paths[answer["key"] in files].add(answer["path"])
    # What lies elsewhere was not written by a crawl, whatever the data say: not ours to remove.
    return files, {path for path in paths[True] - paths[False] if is_inside(root, path)}


@dataclass
class Strip:
    """(kind, envelope, keys) → the envelope without the pages.

    Without entries of lists, whole captures, files of their own.
    """

    keys: Collection[str]
    titles: set[str]
    files: set[str]
    paths: set[str]

    def __call__(self, kind: str, envelope: Envelope, keys: Collection[str]) -> Envelope | None:
        """The same object when it holds none of the pages, None when nothing is left."""
        answer = envelope.response
        if kind == "renders":
            return None if str(answer["page_id"]) in keys else envelope
        if kind == "files":
            return None if answer["key"] in self.files else envelope
        if kind == "imageinfo":
            return self._pages(
                envelope,
                {title for title in envelope.request.params["titles"] if self._file(title)},
            )
        if kind == "titles":
            listed = answer.get("query", {}).get("allpages", [])
            left = [page for page in listed if not self._is(page)]
            return (
                envelope
                if len(left) == len(listed)
                else _with(envelope, answer, {"allpages": left})
            )
        if kind == "pages":
            return self._pages(
                envelope,
                self.titles
                | {
                    page["title"]
                    for page in answer.get("query", {}).get("pages", [])
                    if self._is(page) and "title" in page
                },
            )
        return envelope

    def _without_redirects(self, page: dict[str, Any]) -> dict[str, Any]:
        """The page itself, unless a name that is to go leads to it."""
        held = page.get("redirects", [])
        left = [one for one in held if not self._is(one)]
        return page if len(left) == len(held) else {**page, "redirects": left}

    def _is(self, page: dict[str, Any]) -> bool:
        return str(page.get("pageid")) in self.keys or page.get("title") in self.titles

    def _file(self, title: str) -> bool:
        return any(
            key.rsplit("/", 1)[-1] == title.removeprefix("File:").replace(" ", "_")
            for key in self.files
        )

    def _pages(self, envelope: Envelope, titles: set[str]) -> Envelope | None:
        """Without the pages of these titles, in the answer and in what was asked."""
        query = envelope.response.get("query", {})
        held = query.get("pages", [])
        left = [
            self._without_redirects(page)
            for page in held
            if page.get("title") not in titles and not self._is(page)
        ]
        titles = titles | {
            name for name, title in answers.renamed(query).items() if title in titles
        }
        asked = set(answers.asked(envelope.request.params))
        same = len(left) == len(held) and all(map(operator.is_, left, held))
        if same and not asked & titles:
            return envelope
        if not left and not asked - titles:
            return None
        renamed = [change for change in query.get("normalized", []) if change["to"] not in titles]
        stripped = _with(
            envelope,
            envelope.response,
            {"pages": left, **({"normalized": renamed} if renamed else {})},
        )
        params = dict(envelope.request.params)
        for name, gone in (("titles", titles), ("pageids", set(self.keys))):
            if isinstance(params.get(name), str):
                params[name] = "|".join(
                    part for part in params[name].split("|") if part not in gone
                )
            elif isinstance(params.get(name), list):
                params[name] = [part for part in params[name] if part not in gone]
        return msgspec.structs.replace(
            stripped, request=msgspec.structs.replace(envelope.request, params=params)
        )


def _with(envelope: Envelope, answer: dict[str, Any], change: dict[str, Any]) -> Envelope:
    query = {
        name: value
        for name, value in answer["query"].items()
        if name != "normalized" or "pages" not in change
    }
    return msgspec.structs.replace(envelope, response={**answer, "query": {**query, **change}})
