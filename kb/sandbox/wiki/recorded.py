"""Reads the sandbox's recorded wiki: pages, pictures and answers of `api.php` in data/wiki.

States: the first one, and a later one after some edits, a deletion, a move and a new page.
"""

import json
from functools import cache
from pathlib import Path
from typing import Any
from urllib.parse import quote

from werkzeug.security import safe_join

DATA = Path(__file__).parent.with_name("data") / "wiki"
HOST = "http://wiki.example"
TARGET = 20  # the page that the redirect leads to
KINDS = ("Things", "Places", "Words")
# Moved away and deleted in the later state: what the old addresses show then.
_LATER = {"Lamp buoy": "lamp-float", "Charts": None}


class RecordedWiki:
    """Pages by title, files by path, answers by name. `redirect`: a title that leads to another."""

    redirect = "Rock salt"
    namespace = 0

    def __init__(self) -> None:
        self._pages: dict[bool, dict[str, dict[str, Any]]] = {}

    def html(self, title: str, later: bool) -> str | None:
        """The page of that title, a redirect's target under its own address."""
        title = title.replace("Rock salt", "Saltstone")
        stem = _slugs().get(title)
        if later:
            stem = _LATER.get(title, stem)
        elif title in ("New jetty", "Lamp float"):
            stem = None
        for folder in ([DATA / "html" / "later"] if later else []) + [DATA / "html"]:
            file = folder / f"{stem}.html"
            if stem and file.is_file():
                return file.read_text(encoding="utf-8")
        return None

    def file(self, path: str) -> bytes | None:
        """A picture, a style sheet, a script, or robots.txt."""
        folder, _, name = path.removeprefix("/").partition("/")
        if path == "/robots.txt":
            return (DATA / "robots.txt").read_bytes()
        file = safe_join(str(DATA / folder), name) if folder in ("images", "static") else None
        return Path(file).read_bytes() if file and Path(file).is_file() else None

    def load(self, name: str) -> Any:
        """A recorded answer of the API."""
        return json.loads((DATA / "api" / name).read_text(encoding="utf-8"))

    def pages(self, later: bool) -> dict[str, dict[str, Any]]:
        """The pages of a state by title, redirects too."""
        if later not in self._pages:
            self._pages[later] = self._read(later)
        return self._pages[later]

    def _read(self, later: bool) -> dict[str, dict[str, Any]]:
        address = f"{HOST}/wiki/{name_of(self.redirect)}"
        pages = [
            page
            for page in self.load("later/pages.json" if later else "pages.json")["query"]["pages"]
            if not page.get("missing")
        ]
        if later:
            known = {page["title"] for page in pages}
            for part in (1, 2, 3):
                for page in self.load(f"later/generator-{part}.json")["query"]["pages"]:
                    if page["title"] not in known:
                        named = [{"userid": 3, "name": "Maren Holt"}]
                        pages.append({**page, "contributors": named})
        pages.append(
            {
                "pageid": 27,
                "ns": self.namespace,
                "title": self.redirect,
                "redirect": True,
                "lastrevid": 30,
                "length": 23,
                "fullurl": address,
                "canonicalurl": address,
                "revisions": [{"revid": 30, "parentid": 0, "timestamp": "2024-01-11T10:10:00Z"}],
            }
        )
        return {page["title"]: page for page in pages}

    def names(self, page: dict[str, Any], asked: str) -> dict[str, Any]:
        """Redirects to a page and its categories, of what is asked for."""
        names: dict[str, Any] = {}
        if "redirects" in asked and page["pageid"] == TARGET:
            names["redirects"] = [{"pageid": 27, "ns": self.namespace, "title": self.redirect}]
        if "categories" in asked and not page.get("redirect"):
            kind = KINDS[page["pageid"] % len(KINDS)]
            names["categories"] = [{"ns": 14, "title": f"Category:{one}"} for one in ("All", kind)]
        return names


def name_of(title: str) -> str:
    """A title as a part of an address."""
    return quote(title.replace(" ", "_"), safe="'()!*,;:@/")


@cache
def _slugs() -> dict[str, str]:
    """Title to file stem; the file's own RLCONF has the title."""
    slugs = {}
    for file in sorted((DATA / "html").rglob("*.html")):
        conf = (
            file.read_text(encoding="utf-8")
            .split("window.RLCONF = ", 1)[1]
            .split(";</script>", 1)[0]
        )
        slugs[json.loads(conf)["wgTitle"]] = file.stem
    return slugs
