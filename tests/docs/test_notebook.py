"""docs/first-look.ipynb: its cells run where Jupyter opens it, and show what is stored in it."""

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from tests.docs.notebook import NOTEBOOK, executed
from tests.release.made import build

# Boxes in pixels: a browser's fonts decide about them.
MEASURED = ("cell-11", "cell-12")


def cells(book: dict[str, Any]) -> list[dict[str, Any]]:
    return [cell for cell in book["cells"] if cell["cell_type"] == "code"]


def text_of(cell: dict[str, Any]) -> str:
    """What a cell prints, or the plain text of its value."""
    texts = [one.get("text") or one["data"]["text/plain"] for one in cell["outputs"]]
    return "".join("".join(lines) for lines in texts)


@pytest.mark.parametrize("folder", ["docs", "."])
def test_it_runs_from_its_own_folder_and_from_the_root_and_shows_what_is_stored(
    folder: str, demo: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (demo / folder).mkdir(exist_ok=True)
    monkeypatch.chdir(demo / folder)
    stored = cells(json.loads(NOTEBOOK.read_text(encoding="utf-8")))
    shown = cells(executed())
    assert len(shown) == len(stored)
    for old, new in zip(stored, shown, strict=True):
        assert new["outputs"], new["id"]
        if new["id"] not in MEASURED:
            same = text_of(new).replace(f"{demo}/", "").replace("../data/", "data/")
            assert same == text_of(old), f"{new['id']}: python -m tests.docs.notebook FOLDER"


def test_it_is_a_notebook_with_the_outputs_of_one_run() -> None:
    book = json.loads(NOTEBOOK.read_text(encoding="utf-8"))
    assert (book["nbformat"], book["nbformat_minor"]) == (4, 5)
    assert len({cell["id"] for cell in book["cells"]}) == len(book["cells"]) > 15
    counts = [cell["execution_count"] for cell in cells(book)]
    assert counts == list(range(1, len(counts) + 1))
    kinds = {
        kind for cell in cells(book) for one in cell["outputs"] for kind in one.get("data", {})
    }
    assert kinds == {"text/plain", "text/html", "image/png"}
    assert NOTEBOOK.stat().st_size < 400_000


KERNEL = """
import sys, types
shell = types.ModuleType("IPython")
shell.get_ipython = lambda: types.SimpleNamespace(config={"IPKernelApp": {}})
sys.modules |= {"IPython": shell, "ipykernel": types.ModuleType("ipykernel"), "ipywidgets": None}
import kb
print(kb.load(sys.argv[1]).sql("SELECT 6 * 7 AS n").to_pylist())
"""


def test_a_kernel_without_ipywidgets_answers_queries(tmp_path: Path) -> None:
    """DuckDB refuses there to be told not to show progress."""
    folder = build(tmp_path, sources=("pairs",), n=10) / "release" / "pairs"
    done = subprocess.run(
        [sys.executable, "-c", KERNEL, str(folder)], capture_output=True, text=True, check=False
    )
    assert (done.stdout, done.returncode) == ("[{'n': 42}]\n", 0), done.stderr
