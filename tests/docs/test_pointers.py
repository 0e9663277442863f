"""Comments, docstrings and TOML point only to modules, names and files that exist."""

import ast
import io
import re
import subprocess
import tokenize
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest

from tests.docs.messages import ROOT

_DOTTED = re.compile(r"(?<![\w./-])(?:kb|tests|pipelines)(?:\.[A-Za-z_]\w*)+(?![\w(]*/)")
_FILE = re.compile(r"(?<![\w./<{*-])(?:[\w-]+/)*[\w-]+\.py\b")
# What users call their own files in examples.
_OF_USERS = {"mine.py", "recipe.py", "train.py"}


@cache
def files() -> frozenset[str]:
    listed = subprocess.run(
        ["git", "ls-files", "-co", "--exclude-standard"],
        cwd=ROOT, check=True, capture_output=True, text=True,
    )  # fmt: skip
    return frozenset(path for path in listed.stdout.splitlines() if (ROOT / path).exists())


@cache
def names_in(module: Path) -> frozenset[str]:
    """What a module, or a class in it, defines or imports."""
    names = set[str]()
    for node in ast.walk(ast.parse(module.read_text(encoding="utf-8"))):
        match node:
            case ast.FunctionDef(name=name) | ast.AsyncFunctionDef(name=name):
                names.add(name)
            case ast.ClassDef(name=name):
                names.add(name)
            case ast.alias(name=name, asname=asname):
                names.add(asname or name.partition(".")[0])
            case ast.Name(id=name, ctx=ast.Store()):
                names.add(name)
    return frozenset(names)


def exists(dotted: str) -> bool:
    """Whether a dotted name is a package, a module, or something in one."""
    parts = dotted.split(".")
    for end in range(len(parts), 0, -1):
        place = ROOT.joinpath(*parts[:end])
        rest = parts[end:]
        module = place.with_suffix(".py")
        if module.exists():
            return all(name in names_in(module) for name in rest)
        if place.is_dir():
            init = place / "__init__.py"
            return not rest or (init.exists() and all(name in names_in(init) for name in rest))
    return False


def is_file(name: str) -> bool:
    """Whether a file's path ends with a name."""
    return name in _OF_USERS or any(path == name or path.endswith(f"/{name}") for path in files())


def prose_of(path: str, text: str) -> Iterator[str]:
    """Comments and docstrings of Python, and all of TOML."""
    if path.endswith(".toml"):
        yield text
        return
    for token in tokenize.generate_tokens(io.StringIO(text).readline):
        if token.type == tokenize.COMMENT:
            yield token.string
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant):
            yield str(node.value.value)


def stale_in(prose: str) -> list[str]:
    dotted = [name for name in _DOTTED.findall(prose) if not name.endswith(".py")]
    return [
        *(name for name in dotted if not exists(name)),
        *(name for name in _FILE.findall(prose) if not is_file(name)),
    ]


def test_what_is_pointed_to_exists() -> None:
    stale = [
        f"{path}: {name}"
        for path in sorted(files())
        if path.endswith((".py", ".toml"))
        for prose in prose_of(path, (ROOT / path).read_text(encoding="utf-8"))
        for name in stale_in(prose)
    ]
    assert not stale, "\n".join(stale)


@pytest.mark.parametrize(
    ("prose", "stale"),
    [
        ("as kb.schema.tables has it", []),
        ("in kb.schema.tables.table and kb.pairs", []),
        ("see kb.schema.types", ["kb.schema.types"]),
        ("by kb.pairs.draw.no_such", ["kb.pairs.draw.no_such"]),
        ("parse/answers.py and draw.py", []),
        ("parse/join.py, case_rules.py", ["parse/join.py", "case_rules.py"]),
        ("`[youtube] pipeline = 'mine.py'`", []),
    ],
)
def test_a_pointer_to_nothing_is_noticed(prose: str, stale: list[str]) -> None:
    assert stale_in(prose) == stale
