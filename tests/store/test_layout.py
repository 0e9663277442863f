"""Paths under the data root are written in kb/store/layout.py and nowhere else."""

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

from kb.core.sources import PUBLISHED
from kb.schema import tables
from kb.store.artifact_registry import ARTIFACTS
from kb.store.layout import TOP, Layout, parquet_files

ROOT = Path(__file__).resolve().parents[2]
EXCUSED = ("kb/schema/", "kb/store/layout.py")  # schemas/raw/ is no data
# Names of inputs ("raw/wiki/pages") are declared.
STRINGS = {
    "kb/store/artifact_registry.py": {name for one in ARTIFACTS.values() for name in one.inputs},
    "kb/core/installation.py": {"state"},  # below the user's home
}
# "pairs/pairs" and "links/…" are names of declared tables as well, and with one more part
# ("clean/wiki") names of artifacts, which no path is.
WRITTEN = re.compile(rf"(?:{'|'.join(sorted(set(TOP) - {'pairs', 'links'}))})/[^/ ]+/[^/ ]")


def paths(source: str) -> Iterator[tuple[int, str]]:
    """(line, text) of each string that names a top folder as a part of a path."""
    tree = ast.parse(source)
    for node in ast.walk(tree):
        parts: list[ast.expr] = []
        if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Div):
            parts = [node.left, node.right]
        elif isinstance(node, ast.Call):
            name = getattr(node.func, "attr", getattr(node.func, "id", ""))
            if name in ("Path", "joinpath", "join"):
                parts = node.args
            elif name in ("glob", "rglob"):
                parts = [part for part in node.args if "/" in ast.unparse(part)]
        for part in parts:
            if isinstance(part, ast.JoinedStr):
                part = part.values[0]
            text = part.value if isinstance(part, ast.Constant) else None
            if isinstance(text, str) and text.split("/")[0] in TOP:
                yield part.lineno, text
    yield from whole_paths(tree)


def whole_paths(tree: ast.Module) -> Iterator[tuple[int, str]]:
    """(line, text) of each string that is a path below a top folder, docstrings apart."""
    prose = {id(node.value) for node in ast.walk(tree) if isinstance(node, ast.Expr)}
    for node in ast.walk(tree):
        if isinstance(node, ast.JoinedStr) and id(node) not in prose:
            text = ast.unparse(node)[2:-1]
        elif isinstance(node, ast.Constant) and isinstance(node.value, str):
            text = "" if id(node) in prose else node.value
        else:
            continue
        if WRITTEN.match(text):
            yield node.lineno, text


def test_no_other_file_writes_a_path_under_the_data_root() -> None:
    wrong = []
    for path in [*(ROOT / "kb").rglob("*.py"), *(ROOT / "pipelines").glob("*.py")]:
        name = path.relative_to(ROOT).as_posix()
        if not name.startswith(EXCUSED):
            found = list(paths(path.read_text()))
            excused = STRINGS.get(name, set())
            wrong += [f"{name}:{line}: {text!r}" for line, text in found if text not in excused]
    assert not wrong, "ask kb.store.layout for these paths:\n" + "\n".join(wrong)


@pytest.mark.parametrize(
    "line",
    [
        'root / "clean" / source / "videos"',
        'run.root / "state" / f"{source}.sqlite"',
        'root / f"raw/{source}"',
        'Path(root, "release", source)',
        'root.joinpath("pairs")',
        'root.glob("export/*/x.json")',
        'answer["path"] = "raw/wiki/images/x.png"',
    ],
)
def test_a_path_in_a_string_is_seen(line: str) -> None:
    assert list(paths(line))


def test_files_of_a_table_are_whole_ones_in_order(tmp_path: Path) -> None:
    for name in ("part-00001.parquet", "part-00000.parquet", ".part-00002.parquet", "a.json"):
        (tmp_path / name).touch()
    assert [path.name for path in parquet_files(tmp_path)] == [
        "part-00000.parquet",
        "part-00001.parquet",
    ]
    assert parquet_files(tmp_path / "absent") == []


def test_every_path_is_below_the_root_and_in_a_known_folder(tmp_path: Path) -> None:
    at = Layout(tmp_path)
    found = [at.table(name) for name in tables() if name.partition("/")[0] in PUBLISHED]
    for source in PUBLISHED:
        found += [at.raw(source), at.tombstones(source), at.tombstone_count(source)]
        found += [at.state(source), at.lock(source)]
        found += [at.clean(source), at.filtering(source), at.summary(source)]
        found += [at.annotations(source), at.release(source), at.identity(source)]
        found += [at.restored(source)]
    found += [at.index("youtube"), at.table("labels/labels"), at.table("films/shots")]
    found += [at.export("minedojo", "pairs.json"), at.reconstructed, at.page, at.deposits]
    assert {path.relative_to(tmp_path).parts[0] for path in found} == set(TOP)
    assert at.table("pairs/pairs") == tmp_path / "pairs"
    assert at.table("wiki/pages") == at.clean("wiki", "pages")
