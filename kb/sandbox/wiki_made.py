"""A wiki whose pages are about a profile's keywords: the recorded wiki's pages one for one, with
other words, names and pictures' names in them.

What the recorded wiki's answers say of a page (ids, revisions, times, authors) is kept, so that
both wikis are crawled alike, edits, a deletion and a move included.
"""

from __future__ import annotations

import re
from functools import cache
from pathlib import Path
from typing import Any

from kb.core.templates import environment
from kb.sandbox.domain import CLASSES, Domain
from kb.sandbox.wiki_recorded import HOST, Recorded, name_of

TEMPLATES = Path(__file__).with_name("templates") / "wiki"
MAIN = "Main Page"
# The recorded pages and the templates that stand for them; the last two are of the later state.
_PAGES = {
    "Saltstone": "thing",
    "Tide table": "table",
    "Net loom": "recipe",
    "Harbour pictures": "gallery",
    "Charts": "nested",
    "Weather": "tabs",
    "Sailors' words": "words",
    "Lamp buoy": "clip",
    "Long pier": "long",
    "Île d'Écume & 岩島 (100%)": "unicode",
    "Fog": "short",
    "Rock salt": "",
    "New jetty": "new",
    "Lamp float": "clip",
}
# Titles where there are too few keywords for all pages.
_SPARE = (
    "Overview",
    "Table",
    "Parts",
    "Pictures",
    "Sheet",
    "Two tabs",
    "Words",
    "Colours",
    "Long list",
    "Names",
    "Note",
    "Other name",
    "News",
)
_FILES = {  # the recorded files by the names that the templates give them
    "Harbour_at_dawn": "View_a",
    "Harbour_at_dusk": "View_b",
    "Harbour_mark": "Sign",
    "Old_crane": "High",
    "Rope_walk": "Wide",
    "Pier_head": "Front",
    "Saltstone_face": "Face",
    "SaltSprite_stone": "Mark_a",
    "SaltSprite_flake": "Mark_b",
    "HarbourSprites": "Icons",
    "Buoy_light": "Clip",
    "Invicon_cord": "Icon",
}


class Made(Recorded):
    """The wiki of a domain."""

    def __init__(self, domain: Domain) -> None:
        super().__init__()
        self.domain = domain
        self.namespace = domain.namespace
        self.site = f"{domain.title} Wiki"
        self.titles = (MAIN, *_titles(domain.names))
        self._title = dict(zip([MAIN, *_PAGES], [*self.titles], strict=False))
        self._title["Île d'Écume & 岩島 (100%)"] = f"{self.titles[10]} é & 岩 (100%)"
        self._title["Lamp float"] = f"{self.titles[8]} (moved)"
        self.redirect = self._title["Rock salt"]
        self._recorded = {made: recorded for recorded, made in self._title.items()}

    def html(self, title: str, later: bool) -> str | None:
        """The page of that title, a redirect's target under its own address."""
        recorded = self._recorded.get(title, "")
        recorded = {"Rock salt": "Saltstone"}.get(recorded, recorded)
        known = self.pages(later).get(self._title.get(recorded, ""))
        if recorded == "Lamp buoy" and later:
            known = self.pages(later)[self._title["Lamp float"]]
        if known is None:
            return None
        shown = known["title"]
        return self._rendered(_PAGES.get(recorded, "main"), shown, known, later)

    def file(self, path: str) -> bytes | None:
        """A picture, a style sheet or a script."""
        data = super().file(_swapped(path, {made: old for old, made in _FILES.items()}))
        if data is None or not path.startswith(("/static/common", "/static/site")):
            return data
        text = _swapped(data.decode(), _FILES)
        given = self.domain
        for name, plain in CLASSES.items():
            text = re.sub(rf"(?<=\.){plain}(?= \{{)", given.classes[name], text)
        text = re.sub(r"(?<=\.)animated(?=[ ':])", given.animation, text)
        text = text.replace("animated-active", given.active)
        text = text.replace(".sprite-file", f".{given.sprite_image}")
        return re.sub(r"\.sprite(?= )", f".{given.sprite}", text).encode()

    def load(self, name: str) -> Any:
        """An answer of the API, as the recorded one with other words."""
        made = self._renamed(super().load(name))
        if name == "siteinfo.json" and self.namespace:
            known = made["query"]["namespaces"]
            known[str(self.namespace)] = {**known["0"], "id": self.namespace, "name": "Pages"}
        return made

    def _renamed(self, value: Any) -> Any:
        if isinstance(value, list):
            return [self._renamed(one) for one in value]
        if isinstance(value, str):
            spaced = {old.replace("_", " "): made.replace("_", " ") for old, made in _FILES.items()}
            text = _swapped(value.replace("Brinewick Wiki", self.site), _FILES | spaced)
            return self._title.get(value, text)
        if not isinstance(value, dict):
            return value
        made = {key: self._renamed(one) for key, one in value.items()}
        if made.get("title") in self._recorded and "fullurl" in made:
            made["ns"] = self.namespace
            name = name_of(made["title"])
            made["fullurl"] = made["canonicalurl"] = f"{HOST}/wiki/{name}"
            if "editurl" in made:
                made["editurl"] = f"{HOST}/w/index.php?title={name}&action=edit"
        return made

    def _rendered(self, template: str, title: str, page: dict[str, Any], later: bool) -> str:
        given = self.domain
        config = {
            "wgPageName": title.replace(" ", "_"),
            "wgTitle": title,
            "wgArticleId": page["pageid"],
            "wgRevisionId": page["lastrevid"],
            "wgNamespaceNumber": self.namespace,
            "wgIsRedirect": False,
        }
        text: str = (
            _environment()
            .get_template(f"{template}.html.jinja")
            .render(
                title=title,
                name=name_of(title),
                site=self.site,
                topic=given.title,
                titles=self.titles,
                config=config,
                later=later,
                sprite=given.sprite,
                sprite_image=given.sprite_image,
                animation=given.animation,
                active=given.active,
                classes=given.classes,
            )
        )
        return text


@cache
def _environment() -> Any:
    return environment(TEMPLATES, {"name": name_of}, autoescape=True)


def _titles(names: tuple[str, ...]) -> list[str]:
    """As many titles as pages need, keywords first."""
    wanted = len(_PAGES) - 1
    return list(dict.fromkeys((*names[:wanted], *_SPARE)))[:wanted]


def _swapped(text: str, names: dict[str, str]) -> str:
    for old, new in names.items():
        text = re.sub(rf"(?<![A-Za-z]){re.escape(old)}(?![A-Za-z])", new, text)
    return text
