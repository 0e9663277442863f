"""Figures of wiki pages, in the order of the report.

The first shows pages with the boxes of their elements and of their texts' lines: some whole pages,
and a part of the first at its own size.
"""

from __future__ import annotations

import io
from dataclasses import dataclass
from functools import partial
from typing import Any, NamedTuple

from kb.core.config.profile import Profile
from kb.look.charts import (
    BLUE,
    GREEN,
    INK,
    ORANGE,
    PALE,
    PURPLE,
    RED,
    SKY,
    Figure,
    SavedSheet,
    canvas,
    saved,
)
from kb.report.data import ReportData
from kb.report.figures import dates, funnel, toxicity, values
from kb.store.damage import opening
from kb.store.rawlog import sidefiles

_PAGES = "wiki/pages"


class BoxStyle(NamedTuple):
    """How the boxes of a kind are drawn: lines differ as well as colours."""

    color: str
    line: Any
    width: float


# In the order of the legend; what encloses others is drawn first. Widths are whole CSS pixels
# (0.75 points), so that at 1:1 a line ends where the element begins.
KINDS = {
    "text": BoxStyle(BLUE, "-", 0.75),
    "table": BoxStyle(GREEN, "-", 1.5),
    "cell": BoxStyle(SKY, (0, (4, 1.5)), 0.75),
    "image": BoxStyle(RED, "-", 1.5),
    "sprite": BoxStyle(PURPLE, "-", 1.5),
    "animation": BoxStyle(ORANGE, (0, (1.5, 1)), 1.5),
}
_CSS = 96  # CSS pixels per inch
_EXAMPLES = 4  # pages, as many as the paper shows
_OVERVIEW = 360  # CSS px, the width of a whole page's picture
_CROP = (400, 460)  # CSS px, at most
_MARGIN = 40  # CSS px below the last element
_TALLEST = 1.4  # height of an overview, in widths of the page
_LEGEND = 0.5  # inches: whole pixels at any of our scales
_LETTERS = 13  # points of the legend: it is read on a phone as well


@dataclass(frozen=True)
class DrawnBox:
    """A rectangle in CSS pixels of the page; of a text also those of its lines."""

    x: float
    y: float
    width: float
    height: float
    lines: tuple[DrawnBox, ...] = ()


def pages(data: ReportData, profile: Profile) -> tuple[Figure, ...]:
    """Overviews of the pages whose upper parts show most kinds of elements, and a detail of the
    first of them.

    Without a screenshot the boxes stand on white. Raises DamagedData for one that can't be read.
    """
    if not data.files("wiki/pages") or not data.files("wiki/elements"):
        return ()
    made: list[Figure] = []
    for number in _chosen(data):
        made += _page(data, number, len(made))
    return tuple(made)


def _page(data: ReportData, number: int, before: int) -> tuple[Figure, ...]:
    """The overview of a page, and if none is `before` it also its detail."""
    rows = data.rows(
        "wiki/pages",
        "SELECT title, url, screenshot_path, page_width, page_height FROM {t} WHERE page_id = ?",
        number,
    )
    if not rows:
        return ()
    title, url, shot, width, height = rows[0]
    shown = _shown(data, number, width, height)
    boxes = [
        (kind, DrawnBox(x, y, wide, high, tuple(DrawnBox(**line) for line in lines or ())))
        for kind, x, y, wide, high, lines in data.rows(
            "wiki/elements",
            "SELECT kind, x, y, width, height, lines FROM {t} WHERE page_id = ?"
            " AND visible AND width > 0 AND height > 0 AND y < ? ORDER BY reading_order",
            number,
            shown,
        )
    ]
    if not boxes:
        return ()
    image = _screenshot(data, shot, width, shown)
    shown_part = DrawnBox(0, 0, width, shown)
    source = f"Source: {url}"
    part = "" if shown >= height else f" The upper {shown:,.0f} of {height:,} pixels."
    crop = _crop(data, number, width, shown) if not before else None
    caption = (
        "Boxes of visible elements, of texts a box a line. Dark frame: the part shown in its own"
        " size."
        if crop
        else "Boxes of visible elements."
    )
    overview = Figure(
        f"wiki-page-overview-{before}" if before else "wiki-page-overview",
        f"{title}, with its boxes",
        f"{caption}{part} {source}",
        f"The page {title} with outlines around its elements: {_counted(boxes)}.",
        _drawn(_smaller(image, 2 * _OVERVIEW), shown_part, boxes, _OVERVIEW / width, frame=crop),
        ("kind", "boxes"),
        _counts(boxes),
        screen=True,
        gallery=True,
    )
    if crop is None:
        return (overview,)
    return (
        overview,
        Figure(
            "wiki-page",
            f"{title}, in its own size",
            f"{crop.width:.0f} by {crop.height:.0f} CSS pixels of the page, from "
            f"({crop.x:.0f}, {crop.y:.0f}), at 1:1; each box is drawn just outside of its element, "
            f"texts line by line. {source}",
            f"Part of the page {title} in its own size, with outlines around its elements: "
            f"{_counted(_inside(boxes, crop))}.",
            _drawn(_part(image, shown_part, crop), crop, _inside(boxes, crop), 1.0),
            ("kind", "boxes"),
            _counts(_inside(boxes, crop)),
            screen=True,
        ),
    )


def _chosen(data: ReportData) -> list[int]:
    """The pages with the most kinds of elements, then the most images, near their tops; first those
    with different kinds.
    """
    rows = data.rows(
        "wiki/elements",
        "SELECT page_id FROM (SELECT page_id, list_sort(list(DISTINCT kind)) AS kinds,"
        " least(count(*) FILTER (kind IN ('image', 'sprite', 'animation')), 12) AS images,"
        " least(count(*), 120) AS size FROM {t} WHERE visible AND y < 1600 GROUP BY 1)"
        " ORDER BY row_number() OVER (PARTITION BY kinds ORDER BY images DESC, size DESC, page_id),"
        " len(kinds) DESC, images DESC, size DESC, page_id LIMIT ?",
        _EXAMPLES,
    )
    return [number for (number,) in rows]


def _shown(data: ReportData, number: int, width: float, height: float) -> float:
    """How much of the page the overview shows: pages often end in empty space."""
    low = data.rows(
        "wiki/elements", "SELECT max(y + height) FROM {t} WHERE page_id = ? AND visible", number
    )[0][0]
    return float(min(height, width * _TALLEST, (low or height) + _MARGIN))


def _crop(data: ReportData, number: int, width: float, shown: float) -> DrawnBox:
    """The part with the most kinds of elements that are wholly in it, then the most elements."""
    wide, high = min(_CROP[0], width), min(_CROP[1], shown)
    rows = data.rows(
        "wiki/elements",
        "SELECT l, t FROM (SELECT kind, x, y, x + width AS r, y + height AS b FROM {t}"
        " WHERE page_id = ? AND visible AND width > 0 AND height > 0),"
        f" (SELECT unnest(range(0, {int(width - wide) + 1}, 20)) AS l),"
        f" (SELECT unnest(range(0, {int(shown - high) + 1}, 20)) AS t)"
        f" WHERE x >= l AND y >= t AND r <= l + {wide!r} AND b <= t + {high!r}"
        " GROUP BY ALL ORDER BY count(DISTINCT kind) DESC, count(*) DESC, t, l LIMIT 1",
        number,
    )
    left, top = rows[0] if rows else (0, 0)
    return DrawnBox(left, top, wide, high)


def _screenshot(data: ReportData, shot: str, width: float, shown: float) -> Any:
    """The upper part of the screenshot, or None when the file is not there. Raises DamagedData."""
    path = data.root / shot
    if not path.exists():
        return None
    from PIL import Image

    # A page may be 100,000 pixels high: its own pipeline made it, so Pillow's guard is not for it.
    Image.MAX_IMAGE_PIXELS = None
    hint = "restore it from a copy, or remove it: the figure then has the boxes alone"
    # What Pillow raises for a damaged file.
    png = io.BytesIO(sidefiles.read_captured(data.root, shot))
    with opening(path, SyntaxError, ValueError, hint=hint), Image.open(png) as opened:
        high = min(opened.height, round(shown * opened.width / width))
        return opened.crop((0, 0, opened.width, high)).convert("RGB")


def _drawn(
    image: Any,
    part: DrawnBox,
    boxes: list[tuple[str, DrawnBox]],
    scale: float,
    frame: DrawnBox | None = None,
) -> SavedSheet:
    """A part of the page, `scale` of its own size; a legend above it, and a frame in it."""
    thin = max(scale, 0.5)
    width, height = part.width * scale / _CSS, part.height * scale / _CSS
    sheet, axes = canvas(height + _LEGEND, width=width)
    sheet.set_layout_engine("none")
    axes.set_position((0, 0, 1, height / (height + _LEGEND)))
    right, bottom = part.x + part.width, part.y + part.height
    if image is not None:
        # The screenshot's own pixels: whoever shows the figure scales them once.
        axes.imshow(image, extent=(part.x, right, bottom, part.y), interpolation="none")
    for kind, style in KINDS.items():
        for name, box in boxes:
            for outlined in (box.lines or (box,)) if name == kind else ():
                axes.add_artist(_outline(axes, outlined, style, scale, thin))
    if frame is not None:
        axes.add_artist(_outline(axes, frame, BoxStyle(INK, "-", 1.8), scale))
    axes.set_xlim(part.x, right)
    axes.set_ylim(bottom, part.y)
    axes.set_aspect("auto")
    axes.set_xticks([])
    axes.set_yticks([])
    for side in axes.spines.values():
        side.set_visible(frame is not None)  # at 1:1 it would cover the outermost pixels
        side.set_color(PALE)
    there = [kind for kind in KINDS if any(name == kind for name, _ in boxes)]
    _legend(sheet, there, _LETTERS * min(1.0, width / (600 / _CSS)))
    return saved(sheet, 2 * _CSS)


def _outline(axes: Any, box: DrawnBox, kind: BoxStyle, scale: float, thin: float = 1.0) -> Any:
    """A line around a box that covers nothing of it: its inner edge is the box's edge."""
    from matplotlib.patches import Rectangle

    by = kind.width * thin * _CSS / 72 / 2 / scale
    return Rectangle(
        (box.x - by, box.y - by),
        box.width + 2 * by,
        box.height + 2 * by,
        fill=False,
        edgecolor=kind.color,
        linestyle=kind.line,
        linewidth=kind.width * thin,
        joinstyle="miter",
        transform=axes.transData,  # add_patch would measure each box for limits, which are set
    )


def _legend(sheet: Any, kinds: list[str], points: float) -> None:
    from matplotlib.lines import Line2D

    sheet.legend(
        handles=[
            Line2D(
                [],
                [],
                color=KINDS[kind].color,
                linestyle=KINDS[kind].line,
                linewidth=KINDS[kind].width * 1.3,
                label=kind,
            )
            for kind in kinds
        ],
        loc="upper center",
        fontsize=points,
        ncols=len(kinds),
        handlelength=1.5,
        handletextpad=0.5,
        columnspacing=1.0,
    )


def _smaller(image: Any, width: int) -> Any:
    """A screenshot with at most so many pixels a row: what a small picture can show."""
    if image is None or image.width <= width:
        return image
    from PIL import Image

    size = (width, round(image.height * width / image.width))
    return image.resize(size, Image.Resampling.LANCZOS)


def _part(image: Any, full: DrawnBox, part: DrawnBox) -> Any:
    """The part of a screenshot of `full`, in its own pixels; None without a screenshot."""
    if image is None:
        return None
    ratio = image.width / full.width
    edges = (part.x, part.y, part.x + part.width, part.y + part.height)
    return image.crop(tuple(round(edge * ratio) for edge in edges))


def _inside(boxes: list[tuple[str, DrawnBox]], part: DrawnBox) -> list[tuple[str, DrawnBox]]:
    """The boxes of which something is in the part."""
    return [
        (kind, box)
        for kind, box in boxes
        if box.x < part.x + part.width
        and box.y < part.y + part.height
        and box.x + box.width > part.x
        and box.y + box.height > part.y
    ]


def _counts(boxes: list[tuple[str, DrawnBox]]) -> list[tuple[str, int]]:
    counts = [(kind, sum(name == kind for name, _ in boxes)) for kind in KINDS]
    return [(kind, n) for kind, n in counts if n]


def _counted(boxes: list[tuple[str, DrawnBox]]) -> str:
    return ", ".join(f"{n} {kind}" for kind, n in _counts(boxes))


FIGURES = (
    pages,
    partial(funnel, name=_PAGES),
    partial(
        values,
        table="wiki/elements",
        column="kind",
        name="wiki-elements",
        title="What is on the pages",
        caption="{total} elements, by kind; one that is folded has no box.",
        head=("kind", "elements"),
        colors={kind: style.color for kind, style in KINDS.items()},
        shares=False,
    ),
    partial(dates, table=_PAGES, column="revision_timestamp", what="revised", color=GREEN),
    partial(toxicity, table=_PAGES, columns=("toxicity",)),
)
