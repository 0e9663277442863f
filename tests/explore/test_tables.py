"""Tables are read as they are when a page is asked for."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pyarrow.parquet as pq

from tests.cli.conftest import clean_environment
from tests.conftest import ROOT
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


def test_pages_are_read_while_a_filter_replaces_the_tables(demo: Path, tmp_path: Path) -> None:
    root = tmp_path / "root"
    shutil.copytree(demo / "data" / "demo", root)
    paths = ("/", "/rows?source=wiki", "/thresholds?source=wiki&value=5", "/status")
    with explored(root) as pages:
        command = [sys.executable, "-m", "kb", "wiki", "filter", "--quiet", "--data", str(root)]
        environment = {**clean_environment(), "PYTHONPATH": str(ROOT)}
        for _ in range(3):
            with subprocess.Popen(command, env=environment, cwd=os.sep) as process:
                while process.poll() is None:
                    assert [pages.ask(path).status for path in paths] == [200] * len(paths)
            assert process.returncode == 0
