"""Generates wiki pages about a domain's keywords: infobox, prose, table, redirects, and for every
second page a recipe.

Beside the recorded pages where the domain has these, alone with a main page elsewhere, in the
profile's own markup. In the later state the first page was edited and the last one deleted.
"""

import json
import re
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple
from urllib.parse import quote

from werkzeug.security import safe_join

from kb.core import clock
from kb.core.templates import environment
from kb.sandbox.domain import CLASSES, Domain
from kb.sandbox.speech import Cast, Noun

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

    def target(self, title: str) -> str:
        """Where a redirect leads."""
        return title.replace(self.redirect, "Saltstone")

    def html(self, title: str, later: bool) -> str | None:
        """The page of that title, a redirect's target under its own address."""
        title = self.target(title)
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
            names["categories"] = [
                {"ns": 14, "title": f"Category:{category}"} for category in ("All", kind)
            ]
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


PAGES = 10  # each costs a second or two of a browser's time
TEMPLATES = Path(__file__).parent.with_name("templates") / "wiki"
MAIN = "Main Page"
_RECORDED_SITE = "Brinewick Wiki"
_FIRST_ID = 1_000
# RecordedWiki pictures, by the names that these pages give them.
_FILES = {
    "Face": "Saltstone_face",
    "View": "Harbour_at_dawn",
    "Mark": "SaltSprite_stone",
    "Icons": "HarbourSprites",
    "Icon": "Invicon_cord",
}
_MADE = re.compile(rf"(?<![A-Za-z])({'|'.join(_FILES)})(?=[._])")


class GeneratedPage(NamedTuple):
    """A page: its id, its subject with what kind of thing that is, titles that lead to it."""

    id: int
    noun: Noun
    kind: str
    redirects: tuple[str, ...]
    template: str = "entity"

    @property
    def title(self) -> str:
        return self.noun.title[:1].upper() + self.noun.title[1:]


class GeneratedRecipe(NamedTuple):
    """A recipe: where it is made and the word for that, its rows of slots and what comes out.

    A slot is what it shows in turn, and how many; "" for nothing.
    """

    station: str
    word: str
    shape: str  # what says the station: "class", "caption", "heading" or "picture"
    rows: tuple[tuple[tuple[tuple[str, ...], int], ...], ...]
    outcome: tuple[tuple[tuple[str, ...], int], ...]


_SHAPES = ("class", "caption", "heading", "picture")


class GeneratedWiki(RecordedWiki):
    """The wiki of a domain, with pages for the first `n` of its names."""

    def __init__(self, domain: Domain, n: int = PAGES) -> None:
        super().__init__()
        self.domain, self.namespace = domain, domain.namespace
        self.alone = not domain.recorded_wiki
        self.site = f"{domain.title} Wiki"
        self.entries = _entries(domain, n, self.alone)
        self._by_title = {entry.title: entry for entry in self.entries}
        self._targets = {other: entry.title for entry in self.entries for other in entry.redirects}
        self._by_id = {entry.id: entry for entry in self.entries}

    def target(self, title: str) -> str:
        """Where a redirect leads."""
        return self._targets.get(title) or super().target(title)

    def html(self, title: str, later: bool) -> str | None:
        """The page of that title, a redirect's target under its own address."""
        title = self._targets.get(title, title)
        entry = self._by_title.get(title)
        if entry is None:
            return None if self.alone else super().html(title, later)
        page = self.pages(later).get(title)
        return self._rendered(entry, page, later) if page else None

    def file(self, path: str) -> bytes | None:
        """A picture, a style sheet or a script."""
        data = super().file(_MADE.sub(lambda made: _FILES[made[1]], path))
        if data is None or not self.alone or not re.match(r"/static/(common|site)", path):
            return data
        given, text = self.domain, _renamed(data.decode().replace("recorded wiki", "wiki"))
        for name, plain in CLASSES.items():
            text = re.sub(rf"(?<=\.){plain}(?= \{{)", given.classes[name], text)
        text = re.sub(r"(?<=\.)animated(?=[ ':])", given.animation, text)
        text = text.replace("animated-active", given.active)
        text = text.replace(".sprite-file", f".{given.sprite_image}")
        return re.sub(r"\.sprite(?= )", f".{given.sprite}", text).encode()

    def load(self, name: str) -> Any:
        """A recorded answer of the API, with what these pages add to it."""
        answer = super().load(name)
        if self.alone:
            answer = json.loads(json.dumps(answer).replace(_RECORDED_SITE, self.site))
        query = answer["query"]
        if name == "siteinfo.json" and self.alone and self.namespace:
            spaces = query["namespaces"]
            spaces[str(self.namespace)] = {**spaces["0"], "id": self.namespace, "name": "Pages"}
        elif name == "imageinfo.json":
            made = [_renamed(page) for page in query["pages"]]
            query["pages"] = made if self.alone else [*query["pages"], *made]
        return answer

    def _read(self, later: bool) -> dict[str, dict[str, Any]]:
        pages = {} if self.alone else super()._read(later)
        for place, entry in enumerate(self.entries):
            if not later or entry is not self.entries[-1]:
                edited = later and not place
                pages |= {page["title"]: page for page in self._described(entry, edited)}
        return pages

    def _described(self, entry: GeneratedPage, edited: bool) -> list[dict[str, Any]]:
        """What the API says of a page and of the redirects to it."""
        day = "2024-05-02" if edited else "2024-01-12"
        made = []
        for place, title in enumerate((entry.title, *entry.redirects)):
            revision = 10 * entry.id + place + (5 if edited else 0)
            address = f"{HOST}/wiki/{name_of(title)}"
            made.append(
                {
                    "pageid": entry.id + place,
                    "ns": self.namespace,
                    "title": title,
                    **({"redirect": True} if place else {}),
                    "touched": f"{day}T10:00:00Z",
                    "lastrevid": revision,
                    "length": 900,
                    "fullurl": address,
                    "canonicalurl": address,
                    "revisions": [
                        {
                            "revid": revision,
                            "parentid": revision - 5 if edited else 0,
                            "user": "Ysolde Vane",
                            "timestamp": f"{day}T10:00:00Z",
                            "size": 900,
                            "sha1": f"{revision:040x}",
                        }
                    ],
                    "contributors": [{"userid": 5, "name": "Ysolde Vane"}],
                }
            )
        return made

    def names(self, page: dict[str, Any], asked: str) -> dict[str, Any]:
        """Redirects to a page and its categories, of what is asked for."""
        entry = self._by_id.get(page["pageid"])
        if entry is None:
            return super().names(page, asked)
        names: dict[str, Any] = {}
        if "redirects" in asked and entry.redirects:
            names["redirects"] = [
                {"pageid": entry.id + place, "ns": self.namespace, "title": title}
                for place, title in enumerate(entry.redirects, start=1)
            ]
        if "categories" in asked:
            kinds = ("All", entry.kind)
            names["categories"] = [
                {"ns": 14, "title": f"Category:{category}"} for category in kinds if category
            ]
        return names

    def recipe(self, title: str) -> GeneratedRecipe | None:
        """What a page's recipe says; every second page has one."""
        entry = self._by_title[title]
        number, second = divmod(self.entries.index(entry), 2)
        others = self._others(entry)
        if entry.template != "entity" or not second or len(others) < 3:
            return None
        stations = [*self.domain.stations.items(), ("other", "")]
        station, word = stations[number % len(stations)]
        first, next_, third = others[:3]
        rows = (
            (((first, next_, third), 1), ((next_,), 3)),
            (((), 0), ((third,), 1)),
            (((third,), 1), ((next_,), 2)),
        )
        # The third thing comes back, as an empty bucket does.
        back = (((third,), 1),) if number % 2 else ()
        shape = _SHAPES[number % len(_SHAPES)] if word else ""
        return GeneratedRecipe(station, word, shape, rows, (((title,), 2), *back))

    def _others(self, entry: GeneratedPage) -> list[str]:
        """Titles of the other pages about things, those behind this one first."""
        place = self.entries.index(entry)
        others = [
            other for other in self.entries if other.template == "entity" and other is not entry
        ]
        return [other.title for other in others[place:] + others[:place]]

    def _rendered(self, entry: GeneratedPage, page: dict[str, Any], later: bool) -> str:
        domain = self.domain
        others = self._others(entry)
        rng = clock.rng("wiki page", entry.title)
        nouns = tuple(self._by_title[title].noun for title in others)
        cast = Cast(entry.noun, nouns or (entry.noun,))
        config = {
            "wgPageName": entry.title.replace(" ", "_"),
            "wgTitle": entry.title,
            "wgArticleId": page["pageid"],
            "wgRevisionId": page["lastrevid"],
            "wgNamespaceNumber": self.namespace,
            "wgIsRedirect": False,
        }
        return (
            _environment()
            .get_template(f"{entry.template}.html.jinja")
            .render(
                entry=entry,
                title=entry.title,
                name=name_of(entry.title),
                site=self.site if self.alone else _RECORDED_SITE,
                topic=domain.title,
                others=others,
                where=domain.speech.text("wiki_where", rng, cast, 3).split("\n"),
                use=domain.speech.text("wiki_use", rng, cast, 3 + later).split("\n"),
                counts=[rng.randint(1, 12) for _ in range(6)],
                recipe=self.recipe(entry.title),
                config=config,
                classes=domain.classes,
                sprite=domain.sprite,
                sprite_image=domain.sprite_image,
                animation=domain.animation,
                active=domain.active,
            )
        )


@cache
def _environment() -> Any:
    return environment(TEMPLATES, {"name": name_of}, autoescape=True)


def _entries(domain: Domain, n: int, alone: bool) -> list[GeneratedPage]:
    """The pages, ten ids apart; without recorded ones a main page and a short one too."""
    fit = re.compile(r"\w[\w '(),.!&-]*")
    nouns = {noun.title: noun for noun in domain.speech.nouns}
    listed = [keyword for keyword in domain.keywords if fit.fullmatch(keyword.name)]
    listed = [keyword for keyword in listed if keyword.name not in (MAIN, domain.title)]
    chosen = [(nouns[keyword.name], keyword.kind, keyword.more) for keyword in listed[: n + alone]]
    taken = {noun.title.lower() for noun in nouns.values()}
    entries = []
    for place, (noun, kind, more) in enumerate(chosen):
        names = more[:2] or ((f"{noun.title}s",) if noun.number == "one" else ())
        redirects = tuple(
            name[:1].upper() + name[1:] for name in names if name.lower() not in taken
        )
        template = "entity" if place < n else "short"
        entries.append(
            GeneratedPage(_FIRST_ID + 10 * place, noun, kind.capitalize(), redirects, template)
        )
    if alone:
        entries.insert(0, GeneratedPage(1, Noun(MAIN), "", (), "main"))
    return entries


def _renamed(value: Any) -> Any:
    """The made names of pictures in a recorded answer."""
    if isinstance(value, dict):
        return {key: _renamed(inner) for key, inner in value.items()}
    if isinstance(value, list):
        return [_renamed(inner) for inner in value]
    if isinstance(value, str):
        for made, recorded in _FILES.items():
            for old in (recorded, recorded.replace("_", " ")):
                value = value.replace(old, made)
    return value
