"""Reads the extraction of a captured page: what the page script measured."""

from pathlib import Path
from typing import Any

import msgspec
import zstandard

from kb.store.rawlog import sidefiles

SIDES = ("x", "y", "width", "height")
_FILE = "extraction.json.zst"
# Pages that were captured before these were read have neither facts nor recipes.
_LATER: dict[str, Any] = {"sprites": {}, "facts": [], "recipes": []}


def read(root: Path, folder: Path) -> dict[str, Any]:
    """The extraction in a page's folder: sizes of the `page`, its `elements` in document order,
    `cells` of tables, `sprites`, `facts` and `recipes`.

    Raises DamagedData, and notes the page for the next crawl.
    """
    path = folder / _FILE
    try:
        text = zstandard.ZstdDecompressor().decompressobj().decompress(path.read_bytes())
        content: dict[str, Any] = msgspec.json.decode(text)
    except (OSError, zstandard.ZstdError, msgspec.DecodeError) as error:
        damage = sidefiles.lost(root, "wiki", [path])
        damage.args = (f"{path} can't be read: {error}",)
        raise damage from None
    return _LATER | content


def is_foreign(page: dict[str, Any], page_id: int) -> bool:
    """Whether a capture shows another page than the one it was stored for.

    Earlier versions stored challenge pages like this. `page` is what the extraction says about the
    page; a capture without a page id is trusted.
    """
    return bool(page.get("page_id", page_id) != page_id)
