"""`data.page(…)`: a wiki page with its elements and their boxes, and its screenshot, which is read
from a release's tars or a data root. Pictures need Pillow.
"""

from __future__ import annotations

import base64
import io
import struct
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, cast

import pyarrow as pa

from kb.artifacts.stored_files import stored_file
from kb.artifacts.table_catalog import View
from kb.core.errors import DamagedData, KbError, UsageError
from kb.core.suggestions import did_you_mean, similar
from kb.reader import html
from kb.reader.hints import with_hints
from kb.reader.tables import OpenTables, QueryResult, needs
from kb.schema.conformity import value_problem
from kb.schema.tables import table
from kb.store.damage import DOWNLOAD, opening
from kb.store.tables.remote_files import RemoteFolder

if TYPE_CHECKING:
    from PIL.Image import Image as Picture

COLOURS = {
    "text": "#0072b2",
    "image": "#d55e00",
    "sprite": "#cc79a7",
    "animation": "#e69f00",
    "table": "#009e73",
    "cell": "#56b4e9",
    "video": "#000000",
    "audio": "#000000",
}
_LINE = 2  # CSS px
_PIXELS = 400_000_000  # of a screenshot: 100,000 px of height, and twice the usual width
_PNG = b"\x89PNG\r\n\x1a\n"
_THUMBNAIL = (480, 640)  # px of an image in a notebook, at most; what is below is cut off


class TextLine(NamedTuple):
    """The box of one line of a text, in CSS pixels of the page."""

    x: float
    y: float
    width: float
    height: float


class Box(NamedTuple):
    """An element's box in CSS pixels of the page.

    `lines`: the boxes of a visible text's lines, from the top; None for other elements. Unlike the
    text's own box they don't cover what floats next to the text.
    """

    element_id: int
    kind: str
    tag: str
    region: str
    text: str | None
    x: float
    y: float
    width: float
    height: float
    lines: tuple[TextLine, ...] | None = None

    @property
    def parts(self) -> Sequence[Box | TextLine]:
        """What to draw: the lines if there are any, else the box itself."""
        return self.lines or (self,)


def box(row: dict[str, Any]) -> Box:
    """The box of a row of wiki_elements."""
    lines = row["lines"]
    given = {name: row[name] for name in Box._fields if name != "lines"}
    return Box(**given, lines=lines and tuple(TextLine(**line) for line in lines))


def screenshot(home: Path | RemoteFolder, row: dict[str, Any]) -> Picture:
    """The screenshot of a page's row. Raises MissingExtra and DamagedData.

    Pillow's limit on pixels is lifted only for an image of exactly the size in the page's row, and
    of no more pixels than a page can have.
    """
    needs("PIL", install="pillow")
    from PIL import Image

    _check_size(row)
    data, where = stored_file(home, row["screenshot_path"])
    scale = row["device_pixel_ratio"]
    wanted = [round(row["page_width"] * scale), round(row["page_height"] * scale)]
    # Width and height of a PNG are in its header.
    is_png = len(data) >= 24 and data.startswith(_PNG)
    size = struct.unpack(">II", data[16:24]) if is_png else None
    if (
        size is None
        or size[0] * size[1] > _PIXELS
        or any(abs(side - other) > 2 * scale for side, other in zip(size, wanted, strict=True))
    ):
        raise DamagedData(f"{where} is not a PNG of {wanted[0]} × {wanted[1]} px", hint=DOWNLOAD)
    limit, Image.MAX_IMAGE_PIXELS = Image.MAX_IMAGE_PIXELS, None
    try:
        with opening(where, SyntaxError, ValueError, hint=DOWNLOAD):
            opened = Image.open(io.BytesIO(data), formats=["PNG"])
            opened.load()
    finally:
        Image.MAX_IMAGE_PIXELS = limit
    return opened


def _check_size(row: dict[str, Any]) -> None:
    """Raises DamagedData for sizes of no page: of a release at an address only the footers of its
    files were looked at.
    """
    for name in ("page_width", "page_height", "device_pixel_ratio"):
        column = table("wiki/pages").column(name)
        if what := value_problem(column, pa.array([row[name]])):
            raise DamagedData(f"the page {row['page_id']}: {what}", hint=DOWNLOAD)


def outlined(image: Picture, boxes: Iterable[Box], scale: float) -> Picture:
    """A copy with an outline for each box, or for each line of a text, clipped to the image."""
    needs("PIL", install="pillow")
    from PIL import ImageDraw

    copy = image.convert("RGB")
    pen = ImageDraw.Draw(copy)
    width = max(1, round(_LINE * scale))
    for kind, part in ((box.kind, part) for box in boxes for part in box.parts):
        left, top = round(part.x * scale), round(part.y * scale)
        right = max(left, round((part.x + part.width) * scale) - 1)
        bottom = max(top, round((part.y + part.height) * scale) - 1)
        pen.rectangle((left, top, right, bottom), outline=COLOURS[kind], width=width)
    return copy


class Page:
    """One wiki page.

    page = data.page("Creeper")
    page.title, page.url, page.row["license"]
    page.screenshot()                   # a Pillow image
    page.boxes("table")                 # a list of Box; .draw() draws them
    page.text                           # Markdown
    page.elements, page.cells           # the page's rows
    page.links, page.categories         # where it leads, and what it is filed under
    page.images                         # rows; .open(0) is the first one's file as an image
    page.facts, page.recipes            # from its infoboxes and recipes
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
    def text(self) -> str:
        """The page as Markdown, from wiki_page_text."""
        (row,) = self._rows("page_text", "page_id").to_pylist() or [{"text": ""}]
        return str(row["text"])

    @property
    def links(self) -> QueryResult:
        """The page's rows of wiki_page_links: the pages that it leads to."""
        return self._rows("page_links", "target_title, section, region, text")

    @property
    def categories(self) -> QueryResult:
        """The page's rows of wiki_categories."""
        return self._rows("categories", "category")

    @property
    def images(self) -> Images:
        """The page's rows of wiki_images, with their files."""
        rows = self._rows("images", "element_id, frame_index")
        return Images(rows.to_table(), self._view.home)

    @property
    def facts(self) -> QueryResult:
        """The page's rows of wiki_facts: its infoboxes, field by field."""
        return self._rows("facts", "fact_id")

    @property
    def recipes(self) -> QueryResult:
        """The page's rows of wiki_recipes: the contents of each slot."""
        return self._rows("recipes", "recipe_index, slot, alternative")

    @with_hints
    def screenshot(self) -> Picture:
        """The whole page as a Pillow image, from the release's tar or the data root.

            data.page("Creeper").screenshot().save("creeper.png")

        Raises MissingExtra without Pillow, DamagedData for a tar or image that is missing or
        has another checksum.
        """
        return screenshot(self._view.home, self.row)

    @with_hints
    def boxes(self, kind: str | None = None, *, hidden: bool = False) -> Boxes:
        """The boxes of the page's elements in reading order: all, or those of one kind.

            data.page("Creeper").boxes("table").draw()

        A text's box has the boxes of its lines, which are drawn instead of it. Kinds are text,
        image, sprite, animation, table, cell, video and audio; any other raises UsageError.
        `hidden`: include elements that the page does not show; folded ones have no boxes.
        """
        if kind is not None and kind not in COLOURS:
            kinds = ", ".join(COLOURS)
            raise UsageError(f"unknown kind of element {kind!r}", hint=f"use one of {kinds}")
        boxes = [
            box(row)
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


class Images(QueryResult):
    """Rows of wiki_images, whose files open."""

    def __init__(self, rows: pa.Table, home: Path | RemoteFolder) -> None:
        super().__init__(rows)
        self._home = home

    @with_hints
    def open(self, number: int) -> Picture:
        """The file of a row as a Pillow image: an animation with all its frames.

            data.page("Creeper").images.open(0).show()

        Raises UsageError for a row without a file or with one that Pillow can't read (SVG),
        MissingExtra without Pillow, DamagedData for a file that is missing or was changed.
        """
        needs("PIL", install="pillow")
        from PIL import Image, UnidentifiedImageError

        row = self.to_table().slice(range(self.count_rows())[number], 1).to_pylist()[0]
        if row["path"] is None:
            raise UsageError(
                f"row {number} has no file", hint=f"the wiki's file is at {row['src']}"
            )
        data, where = stored_file(self._home, row["path"])
        try:
            return Image.open(io.BytesIO(data))
        except UnidentifiedImageError:
            raise UsageError(
                f"Pillow can't read {row['media_type']}", hint=f"the file is {where}"
            ) from None


class Boxes(list[Box]):
    """Boxes of one page: a list, which can draw itself."""

    def __init__(self, page: Page, boxes: Iterable[Box]) -> None:
        super().__init__(boxes)
        self._page = page

    @with_hints
    def draw(self) -> Picture:
        """The page's screenshot with an outline for each box, one colour per kind: a Pillow image.
        Each line of a text has an outline of its own.

            data.page("Creeper").boxes("cell").draw().show()

        Raises as `Page.screenshot`.
        """
        scale = self._page.row["device_pixel_ratio"]
        return outlined(self._page.screenshot(), self, scale)

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
        f"unknown page {wanted!r}.{did_you_mean(similar(str(wanted), titles))}",
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
