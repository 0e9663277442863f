"""`data.page(…)`: a wiki page with its screenshot, its elements and their boxes."""

from __future__ import annotations

import base64
import difflib
import io
from collections.abc import Iterable
from typing import TYPE_CHECKING, Any, cast

from kb.artifacts.catalog import View
from kb.core.errors import KbError, UsageError
from kb.reader import html, image
from kb.reader.hints import hinted
from kb.reader.image import Box
from kb.reader.opened import OpenTables
from kb.reader.rows import QueryResult

if TYPE_CHECKING:
    from PIL.Image import Image

_THUMBNAIL = (480, 640)  # px of an image in a notebook, at most; what is below is cut off


class Page:
    """One wiki page.

    page = data.page("Creeper")
    page.title, page.url, page.row["license"]
    page.screenshot()                   # a Pillow image
    page.boxes("table")                 # a list of Box; .draw() draws them
    page.elements, page.cells, page.images      # the page's rows, as answers
    page.facts, page.recipes                    # what its infoboxes and recipes say
    """

    def __init__(self, opened: OpenTables, view: View, row: dict[str, Any]) -> None:
        self._opened, self._view, self.row = opened, view, row

    @property
    def page_id(self) -> int:
        """MediaWiki's page id."""
        return int(self.row["page_id"])

    @property
    def title(self) -> str:
        """The page's title."""
        return str(self.row["title"])

    @property
    def url(self) -> str:
        """The page's address."""
        return str(self.row["url"])

    @property
    def elements(self) -> QueryResult:
        """The page's rows of wiki_elements, in reading order."""
        return self._rows("elements", "reading_order")

    @property
    def cells(self) -> QueryResult:
        """The page's rows of wiki_cells, by table and place."""
        return self._rows("cells", "table_id, row_index, column_index")

    @property
    def images(self) -> QueryResult:
        """The page's rows of wiki_images."""
        return self._rows("images", "element_id, frame_index")

    @property
    def facts(self) -> QueryResult:
        """The page's rows of wiki_facts: what its infoboxes say, field by field."""
        return self._rows("facts", "fact_id")

    @property
    def recipes(self) -> QueryResult:
        """The page's rows of wiki_recipes: what lies in each slot, and in turn."""
        return self._rows("recipes", "recipe_id, slot, alternative")

    @hinted
    def screenshot(self) -> Image:
        """The whole page as a Pillow image, out of the release's tar or the data root.

            data.page("Creeper").screenshot().save("creeper.png")

        Raises MissingExtra without Pillow, DamagedData for a tar or image that is missing or
        not what the release says.
        """
        return image.screenshot(self._view.home, self.row)

    @hinted
    def boxes(self, kind: str | None = None, *, hidden: bool = False) -> Boxes:
        """The boxes of the page's elements in reading order: all, or those of one kind.

            data.page("Creeper").boxes("table").draw()

        A text's box has the boxes of its lines, which are what is drawn of it. Kinds are text,
        image, sprite, animation, table and cell; another raises UsageError.
        `hidden`: also those that the page does not show.
        """
        if kind is not None and kind not in image.COLOURS:
            kinds = ", ".join(image.COLOURS)
            raise UsageError(f"no kind of element is {kind!r}", hint=f"one of {kinds}")
        boxes = [
            image.box(row)
            for row in self.elements
            if (hidden or row["visible"]) and kind in (None, row["kind"])
        ]
        return Boxes(self, boxes)

    def _rows(self, short: str, order: str) -> QueryResult:
        name = f"{self._view.schema}.wiki_{short}"
        if name not in self._opened:
            raise UsageError(f"no table {name} here", hint="data.tables lists what is")
        sql = f"FROM {name} WHERE page_id = ? ORDER BY {order}"
        return QueryResult(self._opened.rows(sql, [self.page_id]))

    def _repr_html_(self) -> str:
        size = f"{self.row['page_width']:,} × {self.row['page_height']:,} px"
        about = f"page {self.page_id}, revision {self.row['revision_id']}, {size}"
        return html.block(
            f"<div>{_thumbnail(self)}</div>",
            caption=f"<b>{html.link(self.url, self.title)}</b> {html.text(about)}",
        )

    def __repr__(self) -> str:
        return f"<wiki page {self.page_id}: {self.title}>"


class Boxes(list[Box]):
    """Boxes of one page: a list, which can draw itself."""

    def __init__(self, page: Page, boxes: Iterable[Box]) -> None:
        super().__init__(boxes)
        self._page = page

    @hinted
    def draw(self) -> Image:
        """The page's screenshot with an outline for each box, a colour a kind: a Pillow image.
        Of a text each line has an outline of its own.

            data.page("Creeper").boxes("cell").draw().show()

        Raises what `Page.screenshot` raises.
        """
        scale = self._page.row["device_pixel_ratio"]
        return image.outlined(self._page.screenshot(), self, scale)

    def _repr_html_(self) -> str:
        said = html.text(f"{self._page.title}: {len(self):,} box{'' if len(self) == 1 else 'es'}")
        return html.block(f"<div>{_thumbnail(self._page, self)}</div>", caption=said)


def find(opened: OpenTables, wanted: int | str) -> Page:
    """A page by its id, its title, or its title in another case. Raises UsageError."""
    ranked = opened.ranked("wiki_pages")
    if not ranked:
        raise UsageError("no wiki pages here", hint="load a wiki release, or a data root with one")
    for view in ranked:
        name = view.full
        tries = [("page_id = ?", wanted)] if isinstance(wanted, int) else _by_title(wanted)
        for condition, value in tries:
            sql = f"FROM {name} WHERE {condition} ORDER BY page_id LIMIT 1"
            if rows := opened.rows(sql, [value]).to_pylist():
                return Page(opened, view, rows[0])
    listed = opened.rows(f"SELECT title FROM {ranked[0].full}")["title"].to_pylist()
    titles = cast("list[str]", listed)
    near = difflib.get_close_matches(str(wanted), titles, 3)
    raise UsageError(
        f"no page {wanted!r} here." + (f" Did you mean {' or '.join(near)}?" if near else ""),
        hint='data["wiki_pages"] has ids and titles',
    )


def _by_title(wanted: str) -> list[tuple[str, int | str]]:
    tries: list[tuple[str, int | str]] = [
        ("title = ?", wanted),
        ("lower(title) = lower(?)", wanted.replace("_", " ")),
    ]
    if wanted.isascii() and wanted.isdigit() and len(wanted) < 19:
        tries.append(("page_id = ?", int(wanted)))
    return tries


def _thumbnail(page: Page, boxes: Boxes | None = None) -> str:
    """A small image inside of the HTML; one line where there is none."""
    try:
        whole = page.screenshot() if boxes is None else boxes.draw()
    except KbError as error:
        return f"<i>{html.text(f'no image: {error} ({error.hint})', 400)}</i>"
    width, height = _THUMBNAIL
    shown = min(whole.height, whole.width * height // width)
    part = whole.crop((0, 0, whole.width, shown))
    part.thumbnail((width, height))
    file = io.BytesIO()
    part.convert("RGB").save(file, "JPEG", quality=80)
    encoded = base64.b64encode(file.getvalue()).decode()
    cut = "" if shown == whole.height else "<div><i>the top of it</i></div>"
    return f'<img src="data:image/jpeg;base64,{encoded}" alt="{html.text(page.title)}">{cut}'
