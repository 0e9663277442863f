"""One wiki page with the boxes of its elements drawn on the screenshot."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from kb.report.data import Data
from kb.report.style import BLUE, GREEN, ORANGE, PURPLE, RED, SKY, WIDTH, Figure, canvas, saved

if TYPE_CHECKING:
    from kb.core.profile import Profile

KINDS = {
    "text": BLUE,
    "image": RED,
    "sprite": PURPLE,
    "animation": ORANGE,
    "table": GREEN,
    "cell": SKY,
}
_MARGIN = 40  # CSS px below the last element
_TALLEST = 1.25  # height of what is shown, in widths of the page


def page(data: Data, profile: Profile) -> Figure | None:
    """The page whose first screen shows most kinds of elements; without screenshot, boxes on white."""
    found = data.rows(
        "wiki/pages",
        (
            "SELECT page_id, title, url, screenshot_path, page_width, page_height, device_pixel_ratio FROM {t} ORDER BY page_id"
        ),
    )
    if not found or not data.files("wiki/elements"):
        return None
    chosen = _chosen(data)
    if chosen is None:
        return None
    number, title, url, shot, width, height, ratio = next(
        (row for row in found if row[0] == chosen), found[0]
    )
    low = data.rows(
        "wiki/elements", "SELECT max(y + height) FROM {t} WHERE page_id = ? AND visible", number
    )[0][0]
    shown = min(
        height, width * _TALLEST, (low or height) + _MARGIN
    )  # pages often end in empty space
    boxes = data.rows(
        "wiki/elements",
        (
            "SELECT kind, x, y, width, height FROM {t} WHERE page_id = ? AND visible AND width > 0 AND height > 0 AND y < ? ORDER BY reading_order"
        ),
        number,
        shown,
    )
    sheet, axes = canvas(WIDTH * shown / width + 0.35)
    image = _screenshot(data, shot, shown, ratio)
    if image is not None:
        axes.imshow(image, extent=(0, width, shown, 0), interpolation="lanczos", aspect="equal")
    _draw(axes, boxes, width, shown)
    png, svg = saved(sheet)
    counts = {kind: sum(box[0] == kind for box in boxes) for kind in KINDS}
    said = ", ".join(f"{n} {kind}" for kind, n in counts.items() if n)
    more = (
        ""
        if shown >= min(height, (low or height) + _MARGIN)
        else f" The first {shown:.0f} of {height:,} pixels are shown."
    )
    return Figure(
        "wiki-page",
        f"A page with its boxes: {title}",
        f"Boxes of visible elements as the browser laid them out, in CSS pixels.{more} Source: {url}",
        f"Screenshot of the page {title} with coloured boxes around its elements: {said}.",
        png,
        svg,
        ("kind", "boxes"),
        [(kind, n) for kind, n in counts.items() if n],
    )


def _chosen(data: Data) -> int | None:
    """The page with the most kinds of elements, then the most pictures, near its top."""
    found = data.rows(
        "wiki/elements",
        "SELECT page_id FROM {t} WHERE visible AND y < 1600 GROUP BY 1 ORDER BY count(DISTINCT kind) DESC,"
        " least(count(*) FILTER (kind IN ('image', 'sprite', 'animation')), 12) DESC, least(count(*), 120) DESC, 1"
        " LIMIT 1",
    )
    return found[0][0] if found else None


def _screenshot(data: Data, shot: str, shown: float, ratio: float) -> Any:
    """The upper part of the screenshot, or None when the file is not there. Raises DamagedData."""
    path = data.path(shot)
    if not path.is_file():
        return None
    from PIL import Image

    from kb.core.errors import DamagedData

    # A page may be 100,000 pixels high: its own pipeline made it, so the guard against bombs is not for it.
    Image.MAX_IMAGE_PIXELS = None
    try:
        with Image.open(path) as picture:
            return picture.crop(
                (0, 0, picture.width, min(picture.height, round(shown * ratio)))
            ).convert("RGB")
    except (
        OSError,
        SyntaxError,
        ValueError,
    ) as error:  # what Pillow raises for a picture that is cut off or none
        hint = "put it back from a copy, or remove it: the figure then has the boxes alone"
        raise DamagedData(f"the screenshot {path} can't be read: {error}", hint=hint) from None


def _draw(axes: Any, boxes: list[tuple[Any, ...]], width: float, shown: float) -> None:
    from matplotlib.patches import Patch, Rectangle

    for kind, x, y, w, h in boxes:
        color = KINDS.get(kind, BLUE)
        axes.add_patch(
            Rectangle((x, y), w, min(h, shown - y), facecolor=color, alpha=0.10, linewidth=0)
        )
        axes.add_patch(
            Rectangle(
                (x, y),
                w,
                min(h, shown - y),
                fill=False,
                edgecolor=color,
                linewidth=0.7 if kind == "cell" else 1.1,
            )
        )
    there = [kind for kind in KINDS if any(box[0] == kind for box in boxes)]
    axes.set_xlim(0, width)
    axes.set_ylim(shown, 0)
    axes.set_aspect("equal")
    axes.set_xticks([])
    axes.set_yticks([])
    for side in axes.spines.values():
        side.set_visible(False)
    axes.figure.legend(
        handles=[
            Patch(facecolor="none", edgecolor=KINDS[kind], linewidth=1.6, label=kind)
            for kind in there
        ],
        loc="outside upper center",
        ncols=len(there),
        handlelength=1.2,
        columnspacing=1.1,
    )
