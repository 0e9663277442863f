"""[wiki]: how pages are shown and measured, which are kept."""

import re
from collections.abc import Iterator, Mapping
from urllib.parse import urlsplit

from pydantic import Field, ValidationInfo, field_validator

from kb.core.config.addresses import root_of
from kb.core.config.section import (
    ERROR,
    FILL_IN,
    WARNING,
    Remark,
    Section,
    SourceSection,
    host_remarks,
)

STILL_S = 0.5  # how long nothing of a page may load or move before it is captured

NOTHING = ":not(*)"  # what a selector that is not set matches

_REGIONS = {
    "infobox": ".infobox, .portable-infobox, .notaninfobox, [class^='infobox']",
    "navbox": ".navbox, .vertical-navbox, .navbox-inner, [role='navigation'].navigation-box",
    "toc": "#toc, .toc, .mw-table-of-contents-container",
    "hatnote": ".hatnote, .dablink, .rellink",
    "gallery": ".gallery, .wikia-gallery, .gallerybox",
    "recipe": "",  # by default what holds a recipe, and slots outside of one
    "other": ".mbox, .ambox, .msgbox, .metadata, .catlinks",
}


class Markup(Section):
    """CSS selectors of what a wiki's markup means. The defaults are MediaWiki's own classes."""

    root: str = Field(
        "#mw-content-text .mw-parser-output, #mw-content-text, .mw-parser-output, #bodyContent,"
        " #content, main, [role=main]",
        description="the element that is read: the first of these that a page has, in this order",
    )
    title: str = Field(
        "#firstHeading, .firstHeading, .mw-first-heading, .page-header__title",
        description="the page's title, which is read where it stands outside of that element",
    )
    chrome: str = Field(
        ".mw-editsection, .mw-editsection-like, .mw-jump-link, #jump-to-nav, #siteSub, #contentSub,"
        " #contentSub2, #mw-content-subtitle, .subpages, #siteNotice, .printfooter, .catlinks,"
        " #catlinks, .mw-indicators, .mw-portlet, .vector-page-toolbar, .toctogglespan,"
        " .toctogglelabel, .mw-cite-backlink, .mw-empty-elt, .mw-collapsible-toggle,"
        " .mw-pt-languages, .mw-pt-translate-header, #mw-fr-revisiontag, .navbar, .navbox-navbar,"
        " [class^='ad-slot'], [class*=' ad-slot'], .incontent-boxad",
        description="edit links and other tools that are not part of the text",
    )
    folded: str = Field(
        "[role=tabpanel], .tabber__panel, .tabbertab, .wds-tab__content, .mw-collapsible-content,"
        " .mw-collapsed, .collapsed, .collapsible-block, .NavContent",
        description="parts that a page shows on demand, besides what says so by its own markup",
    )
    formula: str = Field(
        ".mwe-math-element, .katex, mjx-container, math, img.tex, img[class*=mwe-math]",
        description="formulas, whose text is their TeX",
    )
    fraction: str = Field(".frac, .sfrac, .tion", description="fractions that stand upright")
    denominator: str = Field(
        ".frac .den, .sfrac .den, .tion .den,"
        " .sfrac > span:last-child:not(:first-child, .num, .tion)",
        description="lower parts of fractions; a slash stands before them where none is shown",
    )
    reference: str = Field(
        "sup.reference, sup.mw-ref, sup.footnote-ref, [role=doc-noteref],"
        " sup:has(a[href*='#cite_note']), a[href*='#cite_note']:has(sup)",
        description="footnote marks, which are no part of the text: [note 1]",
    )
    regions: dict[str, str] = Field(
        default_factory=lambda: dict(_REGIONS),
        description="selectors by region name; the innermost region wins. The region `recipe` is"
        " what the keys `recipe` and `slot` select, where nothing else is given",
    )
    sprite: str = Field(".sprite", description="icons shown as a CSS background")
    sprite_image: str = Field(".sprite-file", description="spans that hold an icon as an image")
    animation: str = Field(
        ".animated", description="elements whose children are shown in turn by a script"
    )
    animation_active: str = Field("animated-active", description="class of the visible child")
    animation_group: str = Field(
        ".animated-subframe", description="children with several items that are shown in turn"
    )
    fact: str = Field(
        "tr, .pi-data, .pi-smart-group",
        description="rows of an infobox (the region of that name) that hold fields and values",
    )
    fact_field: str = Field(
        ":scope > th, :scope > .pi-data-label, :scope > * > .pi-smart-data-label",
        description="names in such a row",
    )
    fact_value: str = Field(
        ":scope > td, :scope > .pi-data-value, :scope > * > .pi-smart-data-value",
        description="what the row says of them, in the same order",
    )
    fact_subject: str = Field(
        ".infobox-title, .infobox-above, .pi-title, caption, tr:first-child > th:only-child",
        description="subject of an infobox; default: the page's title",
    )
    units: tuple[str, ...] = Field(
        (),
        description="the domain's own units of figures in infoboxes, besides the usual ones"
        " (kg, hours, % …)",
    )
    recipe: str = Field("", description="grids of slots that show a recipe; none by default")
    slot: str = Field("", description="slots of a recipe")
    slot_row: str = Field("", description="rows of its grid")
    slot_output: str = Field("", description="container of the result's slots")
    quantity: str = Field("", description="how many there are in a slot")
    stations: dict[str, tuple[str, ...]] = Field(
        default_factory=dict,
        description="what recipes are made with: a station's name, and words of which one stands in"
        " what a recipe's grid calls itself (its classes, its picture), in the caption of its table"
        ' or in a heading above it; recipes without one are "other"',
    )
    item: str = Field(
        "",
        description="expression whose group is a thing's name in longer texts of icons and slots",
    )

    @field_validator("*")
    @classmethod
    def _selector(cls, value: object, info: ValidationInfo) -> object:
        optional = info.field_name and cls.model_fields[info.field_name].default == ""
        if (
            isinstance(value, str)
            and info.field_name != "item"
            and (value or not optional)
            and (wrong := selector_problem(value))
        ):
            raise ValueError(wrong)
        return value

    @field_validator("item")
    @classmethod
    def _expression(cls, value: str) -> str:
        try:
            groups = re.compile(value).groups
        except re.error as error:
            raise ValueError(f"is not a regular expression: {error}") from None
        if value and groups != 1:
            raise ValueError("must have one group, which is the name: Icon of (.+)")
        return value

    @field_validator("regions")
    @classmethod
    def _known(cls, value: dict[str, str]) -> dict[str, str]:
        unknown = set(value) - set(_REGIONS)
        if unknown:
            raise ValueError(
                f"has unknown regions {', '.join(sorted(unknown))}; known: {', '.join(_REGIONS)}"
            )
        for name, selector in value.items():
            if selector != _REGIONS[name] and (wrong := selector_problem(selector)):
                raise ValueError(f"{name} {wrong}")
        return value


_FULL_NAME = re.compile(r"[^\s.]+(\.[^\s.]+)+\.?|localhost|.*:.*")
_EXAMPLES = ("example.org", "example.com", "example.net", ".example", ".invalid")


class WikiSection(SourceSection):
    """The wiki part of a profile (MineDojo paper, data collection appendix: Wiki)."""

    table = "wiki"
    about = "Wiki: how its pages are shown and measured, which are kept"
    subject = "url"
    set_elsewhere = True  # KB_WIKI_ROOT
    first = {"url": ("The root of the domain's MediaWiki, with https:// in front.", FILL_IN)}

    url: str = Field(description="the wiki's root; its API is found from the page's EditURI link")
    hosts: tuple[str, ...] = Field(
        (), description="other hosts of the wiki's images, style sheets and scripts"
    )
    namespaces: tuple[int, ...] = Field(
        (), description="namespaces to read; default: the wiki's content namespaces"
    )
    min_words: int = Field(
        20, ge=0, le=500_000, description="minimum words of visible text of a page, including cells"
    )
    viewport_width: int = Field(
        1280, ge=320, le=4096, description="width of the browser's window, in CSS px"
    )
    viewport_height: int = Field(1024, ge=320, le=4096, description="its height, in CSS px")
    settle_seconds: float = Field(
        10,
        gt=0,
        le=120,
        description="seconds after which a page that still moves is measured as it is",
    )
    page_seconds: float = Field(
        60, ge=5, le=600, description="seconds after which a page counts as hung"
    )
    max_page_height: int = Field(
        100_000, ge=1000, description="maximum page height, in CSS px; taller pages are rejected"
    )
    max_elements: int = Field(
        100_000, ge=1000, description="maximum elements of a page; pages with more are rejected"
    )
    max_pixels: int = Field(
        64_000_000,
        ge=1,
        description="maximum pixels of an image; larger ones are stored without being decoded",
    )
    max_file_bytes: int = Field(
        200_000_000, ge=1, description="maximum bytes of an image file; larger ones are not fetched"
    )
    max_tries: int = Field(
        3, ge=1, le=10, description="attempts per page before it counts as not captured"
    )
    seconds_between: float = Field(
        1.0,
        ge=0,
        description="politeness towards a public wiki without a crawl-delay:"
        " seconds between requests",
    )
    markup: Markup = Markup()

    @field_validator("url")
    @classmethod
    def _address(cls, value: str) -> str:
        return root_of(value, "https://minecraft.wiki")

    def other_service(self, noted: Mapping[str, str]) -> str:
        wiki = noted.get("wiki", "")
        known = ("", urlsplit(self.url).hostname, "127.0.0.1", "localhost")
        return "" if wiki.split("/")[0] in known else f"wiki {wiki}"

    def remarks(self) -> Iterator[Remark]:
        parts = urlsplit(self.url)
        host, root = parts.hostname or "", f"{parts.scheme}://{parts.netloc}"
        if not _FULL_NAME.fullmatch(host):
            what = f"'wiki.url' is \"{self.url}\", whose host is not a full name"
            yield ERROR, "wiki.url", what, "write an address like https://minecraft.wiki"
        elif host.endswith(_EXAMPLES):
            yield WARNING, "wiki.url", f"'wiki.url' is the example {self.url}", "write your wiki's"
        if parts.path.endswith(".php"):
            what = f"'wiki.url' is \"{self.url}\", which is not the wiki's root"
            yield ERROR, "wiki.url", what, f'write "{root}"'
        elif re.match(r"/(w|wiki)/.", parts.path):
            what = f"'wiki.url' is \"{self.url}\", which looks like a page"
            yield WARNING, "wiki.url", what, f'the root may be "{root}"'
        yield from host_remarks("wiki.hosts", self.hosts)
        if self.markup.recipe and not self.markup.slot:
            what = "'wiki.markup.recipe' is set, and 'wiki.markup.slot' is not: no recipe is read"
            yield WARNING, "wiki.markup.recipe", what, "name the slots of a recipe too"
        if self.max_page_height < self.viewport_height:
            what = f"'wiki.max_page_height' is {self.max_page_height}: nothing passes"
            fix = f"a page is at least as high as the window, {self.viewport_height} CSS px"
            yield ERROR, "wiki.max_page_height", what, fix
        if self.page_seconds <= self.settle_seconds:
            what = f"'wiki.page_seconds' is {self.page_seconds:g}"
            fix = f"write more than settle_seconds ({self.settle_seconds:g}): moving pages need it"
            yield WARNING, "wiki.page_seconds", what, fix

    @property
    def rules(self) -> dict[str, object]:
        """What the page scripts take: selectors and limits."""
        markup = self.markup
        recipes = ", ".join(filter(None, (markup.recipe, markup.slot))) or NOTHING
        return {
            "root": re.split(r",\s*(?![^(\[]*[)\]])", markup.root),
            "title": markup.title,
            "chrome": markup.chrome,
            "folded": markup.folded,
            "formula": markup.formula,
            "fraction": markup.fraction,
            "denominator": markup.denominator,
            "reference": markup.reference,
            "sprite": markup.sprite,
            "sprite_image": markup.sprite_image,
            "animation": markup.animation,
            "animation_active": markup.animation_active,
            "animation_group": markup.animation_group,
            "fact": markup.fact,
            "fact_field": markup.fact_field,
            "fact_value": markup.fact_value,
            "fact_subject": markup.fact_subject,
            "recipe": markup.recipe or NOTHING,
            "slot": markup.slot or NOTHING,
            "slot_row": markup.slot_row or NOTHING,
            "slot_output": markup.slot_output or NOTHING,
            "quantity": markup.quantity or NOTHING,
            "regions": [(name, selectors or recipes) for name, selectors in markup.regions.items()],
            "infobox": markup.regions.get("infobox", ".infobox"),
            "max_elements": self.max_elements,
            "settle_seconds": self.settle_seconds,
            "still_seconds": STILL_S,
            "image_tries": 2,
            "max_pixels": self.max_pixels,
        }


_NAME = r"(?:[\w-]|[^\x00-\x7f]|\\.)+"
_TEXT = r"\"(?:[^\"\\]|\\.)*\"|'(?:[^'\\]|\\.)*'"
_SIMPLE = re.compile(
    rf"\*|{_NAME}|[.#]{_NAME}"
    rf"|\[\s*{_NAME}(?:\s*[~|^$*]?=\s*(?:{_NAME}|{_TEXT})(?:\s*[iIsS])?)?\s*\]"
    rf"|::?{_NAME}(?P<open>\()?"
)
_COMBINATOR = re.compile(r"\s*[>+~,]\s*|\s+")
_INNER = re.compile(rf"{_TEXT}|[()]|[^()\"']+")


def selector_problem(selector: str) -> str | None:
    """What is wrong with a list of selectors, None where nothing is."""
    text, place = selector.strip(), 0
    if not text:
        return "must be a CSS selector"
    wanted = True  # a simple selector must come
    while place < len(text):
        simple = _SIMPLE.match(text, place)
        if simple is None:
            between = None if wanted else _COMBINATOR.match(text, place)
            if between is None:
                return f"must be a CSS selector; {text[place:][:20]!r} is out of place"
            place, wanted = between.end(), True
            continue
        place, wanted = simple.end(), False
        if simple["open"]:
            end = _closed(text, place)
            if end is None:
                return f"must be a CSS selector; {simple[0]!r} is never closed"
            place = end
    return "must be a CSS selector; it ends before its last part" if wanted else None


def _closed(text: str, place: int) -> int | None:
    """The place behind the bracket that closes one opened before `place`."""
    depth = 1
    while (part := _INNER.match(text, place)) is not None:
        depth += (part[0] == "(") - (part[0] == ")")
        place = part.end()
        if not depth:
            return place
    return None
