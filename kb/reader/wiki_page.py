"""`data.page(…)`: a wiki page with its screenshot, its elements and their boxes."""

from __future__ import annotations

import base64
import io
from collections.abc import Iterable
from typing import TYPE_CHECKING, Any, cast

from kb import query
from kb.artifacts.table_catalog import View
from kb.core.errors import KbError, UsageError
from kb.reader import html, screenshots
from kb.reader.open_tables import OpenTables
from kb.reader.screenshots import Box
from kb.reader.tables import QueryResult, with_hints

if TYPE_CHECKING:
    from PIL.Image import Image

_THUMBNAIL = (480, 640)  # px of an image in a notebook, at most; what is below is cut off


class Page:
    """One wiki page.

    page = data.page("Creeper")
    page.title, page.url, page.row["license"]
    page.screenshot()                   # a Pillow image
    page.boxes("table")                 # a list of Box; .draw() draws them
    page.elements, page.cells, page.images      # the page's rows
    page.facts, page.recipes                    # from its infoboxes and recipes
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
        """The page's rows of wiki_facts: its infoboxes, field by field."""
        return self._rows("facts", "fact_id")

    @property
    def recipes(self) -> QueryResult:
        """The page's rows of wiki_recipes: the contents of each slot."""
        return self._rows("recipes", "recipe_id, slot, alternative")

    @with_hints
    def screenshot(self) -> Image:
        """The whole page as a Pillow image, from the release's tar or the data root.

            data.page("Creeper").screenshot().save("creeper.png")

        Raises MissingExtra without Pillow, DamagedData for a tar or image that is missing or
        has another checksum.
        """
        return screenshots.screenshot(self._view.home, self.row)

    @with_hints
    def boxes(self, kind: str | None = None, *, hidden: bool = False) -> Boxes:
        """The boxes of the page's elements in reading order: all, or those of one kind.

            data.page("Creeper").boxes("table").draw()

        A text's box has the boxes of its lines, which are drawn instead of it. Kinds are text,
        image, sprite, animation, table, cell, video and audio; any other raises UsageError.
        `hidden`: include elements that the page does not show; folded ones have no boxes.
        """
        if kind is not None and kind not in screenshots.COLOURS:
            kinds = ", ".join(screenshots.COLOURS)
            raise UsageError(f"unknown kind of element {kind!r}", hint=f"use one of {kinds}")
        boxes = [
            screenshots.box(row)
            for row in self.elements
            if (row["visible"] or (hidden and row["x"] is not None)) and kind in (None, row["kind"])
        ]
        return Boxes(self, boxes)

    def _rows(self, short: str, order: str) -> QueryResult:
        name = f"{self._view.schema}.wiki_{short}"
        if name not in self._opened:
            raise UsageError(f"the data have no table {name}", hint="data.tables lists the tables")
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

    @with_hints
    def draw(self) -> Image:
        """The page's screenshot with an outline for each box, one colour per kind: a Pillow image.
        Each line of a text has an outline of its own.

            data.page("Creeper").boxes("cell").draw().show()

        Raises as `Page.screenshot`.
        """
        scale = self._page.row["device_pixel_ratio"]
        return screenshots.outlined(self._page.screenshot(), self, scale)

    def _repr_html_(self) -> str:
        caption = html.text(
            f"{self._page.title}: {len(self):,} box{'' if len(self) == 1 else 'es'}"
        )
        return html.block(f"<div>{_thumbnail(self._page, self)}</div>", caption=caption)


def find(opened: OpenTables, wanted: int | str) -> Page:
    """A page by its id, its title, or its title in another case. Raises UsageError."""
    ranked = opened.ranked("wiki_pages")
    if not ranked:
        raise UsageError(
            "the data contain no wiki pages", hint="load a wiki release or a data root with one"
        )
    tries: list[tuple[str, int | str]] = [("page_id = ?", wanted)]
    if isinstance(wanted, str):
        in_any_case = "lower(title) = lower(?)", wanted.replace("_", " ")
        tries = [("title = ?", wanted), in_any_case]
        if wanted.isascii() and wanted.isdigit() and len(wanted) < 19:
            tries.append(("page_id = ?", int(wanted)))
    for view in ranked:
        for condition, value in tries:
            sql = f"FROM {view.full} WHERE {condition} ORDER BY page_id LIMIT 1"
            if rows := opened.rows(sql, [value]).to_pylist():
                return Page(opened, view, rows[0])
    listed = opened.rows(f"SELECT title FROM {ranked[0].full}")["title"].to_pylist()
    titles = cast("list[str]", listed)
    raise UsageError(
        f"unknown page {wanted!r}.{query.did_you_mean(query.similar(str(wanted), titles))}",
        hint='data["wiki_pages"] lists ids and titles',
    )


def _thumbnail(page: Page, boxes: Boxes | None = None) -> str:
    """A small image inside the HTML, or a line that explains why there is none."""
    try:
        image = page.screenshot() if boxes is None else boxes.draw()
    except KbError as error:
        return f"<i>{html.text(f'no image: {error} ({error.hint})', 400)}</i>"
    width, height = _THUMBNAIL
    shown = min(image.height, image.width * height // width)
    part = image.crop((0, 0, image.width, shown))
    part.thumbnail((width, height))
    file = io.BytesIO()
    part.convert("RGB").save(file, "JPEG", quality=80)
    encoded = base64.b64encode(file.getvalue()).decode()
    cut = "" if shown == image.height else "<div><i>top of the page</i></div>"
    return f'<img src="data:image/jpeg;base64,{encoded}" alt="{html.text(page.title)}">{cut}'
