"""Runs docs/first-look.ipynb and stores what its cells show, as Jupyter would.

python -m tests.docs.notebook FOLDER    FOLDER holds data/demo, as `kb demo` makes it there
"""

import ast
import base64
import contextlib
import io
import json
import os
import re
import sys
from pathlib import Path
from typing import Any

NOTEBOOK = Path(__file__).resolve().parents[2] / "docs" / "first-look.ipynb"


def executed() -> dict[str, Any]:
    """The notebook with the outputs of its cells, run in the working folder of this process."""
    book: dict[str, Any] = json.loads(NOTEBOOK.read_text(encoding="utf-8"))
    names: dict[str, Any] = {}
    code = [cell for cell in book["cells"] if cell["cell_type"] == "code"]
    for number, cell in enumerate(code, 1):
        printed = io.StringIO()
        with contextlib.redirect_stdout(printed):
            value = _value_of("".join(cell["source"]), names)
        cell["execution_count"] = number
        cell["outputs"] = [*_stream(printed.getvalue()), *_result(value, number)]
    return book


def _value_of(source: str, names: dict[str, Any]) -> Any:
    """Run a cell: the value of its last line, where that is an expression."""
    tree = ast.parse(source)
    last = tree.body.pop() if isinstance(tree.body[-1], ast.Expr) else None
    exec(compile(tree, str(NOTEBOOK), "exec"), names)
    if not isinstance(last, ast.Expr):
        return None
    return eval(compile(ast.Expression(last.value), str(NOTEBOOK), "eval"), names)


def _stream(text: str) -> list[dict[str, Any]]:
    return [{"name": "stdout", "output_type": "stream", "text": _lines(text)}] if text else []


def _result(value: Any, number: int) -> list[dict[str, Any]]:
    if value is None:
        return []
    shown: dict[str, Any] = {}
    if picture := getattr(value, "_repr_png_", lambda: None)():
        shown["image/png"] = base64.b64encode(picture).decode()
    if page := getattr(value, "_repr_html_", lambda: None)():
        shown["text/html"] = _lines(page)
    shown["text/plain"] = _lines(repr(value))
    return [{"data": shown, "execution_count": number, "metadata": {}}
            | {"output_type": "execute_result"}]  # fmt: skip


def _lines(text: str) -> list[str]:
    """Lines of an output, without what differs from one folder and process to the next."""
    same = re.sub(r" at 0x[0-9A-Fa-f]+", "", text.replace(f"{Path.cwd()}{os.sep}", ""))
    return same.splitlines(keepends=True)


def main() -> None:
    """Write the notebook with its outputs."""
    os.chdir(sys.argv[1])
    text = json.dumps(executed(), indent=1, ensure_ascii=False)
    NOTEBOOK.write_text(f"{text}\n", encoding="utf-8")


if __name__ == "__main__":
    main()
