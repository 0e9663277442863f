"""What released pages lack, measured on them: sentences for card and datasheet."""

from collections.abc import Iterator

from duckdb import DuckDBPyConnection

from kb.artifacts.release_folder import ReleaseFolder
from kb.store.tables.reading import scan

_PILLOW_LIMIT = 178_956_970  # pixels: twice Image.MAX_IMAGE_PIXELS, above which Pillow refuses


def gaps(con: DuckDBPyConnection, folder: ReleaseFolder) -> Iterator[str]:
    """Screenshots that Pillow does not open by default."""
    if not (shards := folder.shards("pages")):
        return
    pixels = "page_width * page_height * device_pixel_ratio * device_pixel_ratio"
    ((large,),) = con.execute(
        f"SELECT count(*) FROM {scan(shards)} WHERE {pixels} > {_PILLOW_LIMIT}"
    ).fetchall()
    if not large:
        return
    yield (
        f"{large:,} {'screenshot has' if large == 1 else 'screenshots have'} more than"
        f" {_PILLOW_LIMIT / 1e6:.1f} megapixels, which Pillow refuses to open until"
        " `PIL.Image.MAX_IMAGE_PIXELS = None` is set; `kb.load` opens them."
    )
