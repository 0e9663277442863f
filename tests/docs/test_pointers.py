"""What comments, docstrings and TOML name is there: modules, files, attributes and columns."""

import ast
import io
import re
import subprocess
import tokenize
from collections import defaultdict
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import NamedTuple

import pytest

ROOT = Path(__file__).resolve().parents[2]
# What belongs to others, or is a user's.
OTHERS = {"detoxify/detoxify.py", "mine.py", "save_additional_columns", "hf_xet", "no_proxy"}
_DOCUMENTED = (ast.Module, ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef)


class Names(NamedTuple):
    """What can be pointed at: files, names in each module and class, and every word of code."""

    files: list[str]
    modules: dict[str, set[str]]
    classes: dict[str, set[str]]
    words: set[str]

    def stale(self, prose: str) -> Iterator[str]:
        """The names in a comment, docstring or line of TOML that lead nowhere."""
        for module in re.findall(r"\bkb(?:\.\w+)+", prose):
            if not self._is_importable(module):
                yield module
        for path in re.findall(r"(?<![\w<>*{}./-])(?:[\w-]+/)*[\w-]+\.py\b", prose):
            if path not in OTHERS and not any(
                f"/{file}".endswith(f"/{path}") for file in self.files
            ):
                yield path
        for owner, attribute in re.findall(r"`([A-Z]\w+)\.(\w+)`", prose):
            if attribute not in self.classes.get(owner, {attribute}):
                yield f"{owner}.{attribute}"
        for word in re.findall(r"`(\w*(?:_|[a-z][A-Z])\w*)`", prose):
            if word not in self.words and word not in OTHERS:
                yield word

    def _is_importable(self, dotted: str) -> bool:
        parts = dotted.split(".")
        for size in range(len(parts), 0, -1):
            if (module := ".".join(parts[:size])) in self.modules:
                return size == len(parts) or parts[size] in self.modules[module]
        return False


def _statements(node: ast.AST) -> Iterator[ast.AST]:
    """A module or statement and all statements in it."""
    yield node
    for block in ("body", "orelse", "finalbody", "handlers", "cases"):
        for inner in getattr(node, block, ()):
            yield from _statements(inner)


def _docstrings(statements: list[ast.AST]) -> Iterator[ast.Constant]:
    """Docstrings, and strings that stand below a constant or a field."""
    for node in statements:
        for line in node.body if isinstance(node, _DOCUMENTED) else ():
            text = line.value if isinstance(line, ast.Expr) else None
            if isinstance(text, ast.Constant) and isinstance(text.value, str):
                yield text


@cache
def repository() -> tuple[Names, dict[str, list[str]]]:
    """Names of this repository, and its prose by `<file>:<line>`, without those of this file."""
    listed = subprocess.run(
        ["git", "ls-files", "--cached", "--others", "--exclude-standard"],
        cwd=ROOT, capture_output=True, text=True, check=True,
    ).stdout.splitlines()  # fmt: skip
    here = Path(__file__).resolve()
    files = [file for file in listed if (ROOT / file).is_file() and ROOT / file != here]
    names = Names(files, {}, defaultdict(set), set(re.findall(r"\w+", "\n".join(files))))
    prose: dict[str, list[str]] = defaultdict(list)
    for file in files:
        if file.endswith(".py"):
            _take_code(file, names, prose)
        elif file.endswith(".toml"):
            for number, line in enumerate((ROOT / file).read_text("utf-8").splitlines(), start=1):
                prose[f"{file}:{number}"].append(line)
                names.words.update(re.findall(r"\w+", line.partition("# ")[0]))
        elif file.endswith((".json", ".html", ".jinja", ".js", ".yml")):
            names.words.update(re.findall(r"\w+", (ROOT / file).read_text("utf-8")))
    return names, prose


def _take_code(file: str, names: Names, prose: dict[str, list[str]]) -> None:
    source = (ROOT / file).read_text("utf-8")
    statements = [*_statements(ast.parse(source))]
    documented = set()
    for text in _docstrings(statements):
        prose[f"{file}:{text.lineno}"].append(str(text.value))
        documented.add((text.lineno, text.col_offset))
    words: list[tuple[int, str]] = []  # with their lines
    for token in tokenize.generate_tokens(io.StringIO(source).readline):
        if token.type == tokenize.COMMENT:
            prose[f"{file}:{token.start[0]}"].append(token.string)
        elif token.type == tokenize.NAME:
            words.append((token.start[0], token.string))
        elif token.type != tokenize.OP and token.start not in documented:
            words += [(token.start[0], word) for word in re.findall(r"\w+", token.string)]
    module = file.removesuffix(".py").removesuffix("/__init__").replace("/", ".")
    names.modules[module] = {word for _, word in words}
    names.words.update(names.modules[module])
    for node in statements:
        if isinstance(node, ast.ClassDef):
            lines = range(node.lineno, (node.end_lineno or node.lineno) + 1)
            names.classes[node.name].update(word for line, word in words if line in lines)


def test_what_prose_names_is_there() -> None:
    names, prose = repository()
    stale = [
        f"{place}: {name}"
        for place, texts in prose.items()
        for text in texts
        for name in names.stale(text)
    ]
    assert stale == [], "\n".join(stale)


@pytest.mark.parametrize(
    ("prose", "stale"),
    [
        ("see kb.schema.types", ["kb.schema.types"]),
        ("see kb.schema.tables and kb.schema.tables.parse_type", []),
        ("kb.schema.tables.no_such_parser", ["kb.schema.tables.no_such_parser"]),
        ("kb/youtube/parse/join.py says", ["kb/youtube/parse/join.py"]),
        ("(join_of_old.py), parse/assemble.py", ["join_of_old.py"]),
        ("As `RestoreJob.plan` and `RestoreJob.no_plan`", ["RestoreJob.no_plan"]),
        ("`video_id` of `vidoe_id`", ["vidoe_id"]),
        ("calls `pairsOfAll`", ["pairsOfAll"]),
    ],
)
def test_a_name_that_leads_nowhere_is_told_from_one_that_is_there(
    prose: str, stale: list[str]
) -> None:
    assert [*repository()[0].stale(prose)] == stale
