"""Tables are read as they are when a page is asked for."""

import shutil
from pathlib import Path

import pyarrow.parquet as pq

from tests.explore.conftest import explored, total


def test_a_row_that_is_gone_disappears_from_the_next_page(demo: Path, tmp_path: Path) -> None:
    root = tmp_path / "root"
    for name in ("clean/youtube", "state"):
        shutil.copytree(demo / "data" / "demo" / name, root / name)
    with explored(root) as pages:
        before = total(pages.ask("/rows?source=youtube").text)
        folder = root / "clean" / "youtube"
        (folder / "_manifest.json").unlink()
        part = next(iter((folder / "videos").glob("*.parquet")))
        rows = pq.read_table(part)
        pq.write_table(rows.slice(1), part)
        assert total(pages.ask("/rows?source=youtube").text) == before - 1
