"""docs/first-look.ipynb: its cells run in order on the demo's release and show something."""

from __future__ import annotations

import ast
import json
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).resolve().parents[2]
NOTEBOOK = ROOT / "docs" / "first-look.ipynb"


def cells() -> list[dict[str, Any]]:
    return list(json.loads(NOTEBOOK.read_text(encoding="utf-8"))["cells"])


def run(source: str, names: dict[str, Any]) -> Any:
    """What a cell shows: the value of its last line, where that is an expression."""
    tree = ast.parse(source)
    last = tree.body.pop() if isinstance(tree.body[-1], ast.Expr) else None
    exec(compile(tree, str(NOTEBOOK), "exec"), names)
    if last is None:
        return None
    assert isinstance(last, ast.Expr)
    return eval(compile(ast.Expression(last.value), str(NOTEBOOK), "eval"), names)


def test_every_cell_runs_and_shows_something(
    demo: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(demo)
    names: dict[str, Any] = {}
    shown = []
    for cell in cells():
        if cell["cell_type"] == "code":
            value = run("".join(cell["source"]), names)
            printed = capsys.readouterr().out
            assert value is not None or printed
            shown.append(printed or _as_shown(value))
    assert "release.youtube_videos" in shown[1]
    assert "<th>manual</th>" in shown[4] or "<td>manual</td>" in shown[4]
    assert "data:image/jpeg" in shown[6]
    assert "<td>in rain</td>" in shown[10]
    assert "<td>output</td>" in shown[11]
    assert "points" in shown[12]
    assert "Creeper" in names["data"].clips("creeper").to_pandas()["keyword"].tolist()
    assert "not here (deleted, or left out by a filter)" in shown[12]
    comments = [line for line in shown[14].splitlines() if line.startswith("  ")]
    assert len(comments) == len(names["data"].thread(names["post_id"])) > 3
    assert all(line.partition(") ")[2] for line in comments), "no texts"
    assert "creeper" in shown[15].lower()


def _as_shown(value: Any) -> str:
    text = value._repr_html_() if hasattr(value, "_repr_html_") else repr(value)
    assert text
    return str(text)


def test_it_is_a_notebook_without_outputs() -> None:
    book = json.loads(NOTEBOOK.read_text(encoding="utf-8"))
    assert (book["nbformat"], book["nbformat_minor"]) == (4, 5)
    assert len({cell["id"] for cell in book["cells"]}) == len(book["cells"]) > 15
    for cell in book["cells"]:
        if cell["cell_type"] == "code":
            assert cell["outputs"] == []
            assert cell["execution_count"] is None
