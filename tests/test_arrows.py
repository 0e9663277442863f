"""The import arrows of the design, read from the source text:

cli → pipelines → registry → {youtube, wiki, reddit} → source → crawl and {mcp, reader, links,
    search, export, report}, {annotate, filters, pairs, release, query} → artifacts → store →
    {schema, net} → core

Imports within functions, where they run late, and for types count as any other. `source` (the class
that a source inherits) and `registry` are modules.
"""

from __future__ import annotations

import ast
import functools
import re
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

from kb.core.sources import SOURCES

ROOT = Path(__file__).resolve().parent.parent
ROOMS = {*SOURCES, "annotate", "filters", "pairs", "export", "release", "report", "verify"}
GROUND = {"net", "store", "schema", "artifacts"}
DATA = {"artifacts", "store", "schema", "core"}
MODULES = {"source", "registry"}  # not packages
MADE = {"clips", "labels", "links", "score", "tasks"}
ASKING = {"query", "search"}  # over the ground alone; only commands and pipelines ask it

# room -> the rooms that it may import (itself always)
ALLOWED: dict[str, set[str]] = {
    "core": set(),
    "schema": {"core"},
    "net": {"core"},
    "look": {"schema", "core"},
    "store": {"schema", "net", "core"},
    "artifacts": {"store", "schema", "core"},
    "crawl": GROUND | {"core"},
    **{room: GROUND | {"core"} for room in ROOMS},
    "report": GROUND | {"core", "look"},
    **dict.fromkeys(
        SOURCES,
        GROUND
        | {"core", "crawl", "export", "links", "search", "reader", "mcp", "report", "look"}
        | {"source", "filters"},
    ),
    "source": GROUND
    | {"core", "crawl", "export", "links", "search", "reader", "mcp", "report", "look"},
    "registry": {"source", "artifacts", "schema", "core", "export", "release", "report", *SOURCES},
    **dict.fromkeys(ASKING, DATA),
    "links": {"pairs", *DATA},  # over the pairs' matcher
    "labels": {"pairs", *DATA},  # over the pairs' transcripts
    "tasks": {"pairs", *DATA},
    "clips": {"pairs", *DATA},  # over the pairs' tokens
    "score": {
        "annotate",
        "clips",
        "pairs",
        *DATA,
    },  # over the clips' films and annotate's downloads
    "reader": {"clips"} | ASKING | DATA,
    "mcp": {"reader"} | ASKING | DATA,
    "explore": {"filters", "mcp", "reader", "look", "labels", "clips", "pairs", "score"}
    | ASKING
    | DATA,
    "sandbox": ROOMS | GROUND | {"core"},
    "cli": ROOMS
    | ASKING
    | GROUND
    | {"core", "crawl", *MADE, "sandbox", "mcp", "explore", "registry", "source"},
    "pipelines": ROOMS | ASKING | GROUND | {"core", "crawl", *MADE, "sandbox", "registry"},
}

# Standard library and light packages only: what `kb --help` may load.
HEAVY = {
    "torch",
    "transformers",
    "detoxify",
    "onnxruntime",
    "selenium",
    "dask",
    "distributed",
    "matplotlib",
    "wordcloud",
    "mlcroissant",
    "mcp",
    "cffconvert",
    "PIL",
    "datasets",
    "polars",
    "pandas",
    "scipy",
    "tokenizers",
    "av",
    "cv2",
    "scenedetect",
    "numpy",
}


def python_files(root: Path = ROOT) -> list[Path]:
    return sorted([*(root / "kb").rglob("*.py"), *(root / "pipelines").glob("*.py")])


def room_of(path: Path, root: Path) -> str:
    parts = path.relative_to(root).parts
    if parts[0] == "pipelines":
        return "pipelines"
    return parts[1] if len(parts) > 2 else path.stem if path.stem in ALLOWED else ""


@functools.cache
def parsed(path: Path) -> ast.Module:
    return ast.parse(path.read_text())


def imported(tree: ast.AST, path: Path, root: Path = ROOT) -> list[tuple[int, str]]:
    """(line, module) of every import anywhere in the file, relative ones made absolute."""
    package = [*path.relative_to(root).with_suffix("").parts][:-1]
    found = []
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            found += [(node.lineno, alias.name) for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            if node.level:
                base = package[: len(package) - node.level + 1]
                module = ".".join([*base, *([node.module] if node.module else [])])
            else:
                module = node.module or ""
            found += [(node.lineno, f"{module}.{alias.name}") for alias in node.names]
    return found


def against_the_arrows(root: Path) -> list[str]:
    """Every import in a checkout that no arrow allows, as "file:line imports …"."""
    wrong = []
    for path in python_files(root):
        room = room_of(path, root)
        for line, module in imported(parsed(path), path, root):
            place = f"{path.relative_to(root)}:{line}"
            parts = module.split(".")
            if parts[0] == "pipelines":
                wrong.append(f"{place} imports {module}: pipelines are loaded by path")
            if parts[0] != "kb" or len(parts) < 2 or parts[1] not in ALLOWED:
                continue
            if room and parts[1] != room and parts[1] not in ALLOWED[room]:
                wrong.append(f"{place} imports {module}: {room} may not import {parts[1]}")
    return wrong


def test_rooms_import_along_the_arrows() -> None:
    wrong = against_the_arrows(ROOT)
    assert not wrong, "\n".join(wrong)


def planted(root: Path, code: str) -> list[str]:
    """What is reported where a file of each room, but for the highest, has this code; {} stands for
    a room that it may not import.
    """
    wrong = []
    for room in sorted(ALLOWED.keys() - {"cli", "pipelines"}):
        above = min(ALLOWED.keys() - ALLOWED[room] - {room, "pipelines"})
        place = root / "kb" / room / "planted.py" if room not in MODULES else root / f"kb/{room}.py"
        place.parent.mkdir(parents=True, exist_ok=True)
        place.write_text(code.format(above))
        wrong.append(f"{place.relative_to(root)}:")
    return wrong


@pytest.mark.parametrize(
    "code",
    [
        "from kb import {}\n",
        "import kb.{}.parse\n",
        "def late():\n    from kb.{}.anything import Name\n",
        "from typing import TYPE_CHECKING\n\nif TYPE_CHECKING:\n    from kb.{} import Name\n",
    ],
)
def test_planted_imports_upwards_are_reported(tmp_path: Path, code: str) -> None:
    """In every room, also where they would run late or are for types alone."""
    places = planted(tmp_path, code)
    wrong = against_the_arrows(tmp_path)
    assert len(wrong) == len(places)
    for place in places:
        assert any(line.startswith(place) and " may not import " in line for line in wrong), place


def test_no_room_is_above_itself() -> None:
    """Arrows in a circle would allow any import among the rooms on it."""
    below = {room: set(ALLOWED[room]) for room in ALLOWED}
    while below:
        lowest = [room for room, others in below.items() if not others & below.keys()]
        assert lowest, f"a circle: {sorted(below)}"
        for room in lowest:
            del below[room]


def file_imports(root: Path) -> dict[str, set[str]]:
    """The modules of kb/ that each one imports, late and for types too."""
    modules = {
        ".".join(path.relative_to(root).with_suffix("").parts).removesuffix(".__init__"): path
        for path in (root / "kb").rglob("*.py")
    }
    found: dict[str, set[str]] = {}
    for name, path in modules.items():
        tree = parsed(path)
        named = [module for _, module in imported(tree, path, root)]
        found[name] = {
            module if module in modules else module.rpartition(".")[0] for module in named
        } & modules.keys()
    return found


def test_no_file_imports_one_that_imports_it() -> None:
    """Not for types either: what two files need has its place below both."""
    below = {name: others - {name} for name, others in file_imports(ROOT).items()}
    assert len(below) > 300
    TopologicalSorter(below).prepare()  # a CycleError names the circle
    below["kb.core.clock"] = {"kb.core.signals"}
    below["kb.core.signals"] = {"kb.core.clock"}
    with pytest.raises(CycleError):
        TopologicalSorter(below).prepare()


@pytest.mark.parametrize("source", SOURCES)
def test_a_source_imports_nothing_but_its_base_until_it_is_asked(source: str) -> None:
    """Every command reads the classes of all sources."""
    path = SOURCES[source].package / "source.py"
    loaded = _module_level(parsed(path).body)
    modules = {module for node in loaded for _, module in imported(node, path)}
    assert not {name for name in modules if re.match(r"kb\.(?!source\b)", name)}


@pytest.mark.parametrize("source", SOURCES)
def test_settings_import_the_ground_alone(source: str) -> None:
    """A profile is read by rooms below the source."""
    path = SOURCES[source].package / "section.py"
    modules = {module for _, module in imported(parsed(path), path)}
    assert not {name for name in modules if re.match(r"kb\.(?!core\.)", name)}


def test_every_room_has_its_arrows() -> None:
    rooms = {
        path.name for path in (ROOT / "kb").iterdir() if path.is_dir() and any(path.glob("*.py"))
    }
    assert rooms <= set(ALLOWED), f"say in this test what these may import: {rooms - set(ALLOWED)}"


def test_heavy_packages_are_imported_inside_functions_only() -> None:
    """Module level imports of optional packages would make a base install unusable."""
    wrong = []
    for path in python_files():
        for node in _module_level(parsed(path).body):
            for line, module in imported(node, path):
                if module.split(".")[0] in HEAVY:
                    wrong.append(
                        f"{path.relative_to(ROOT)}:{line} imports {module} at module level"
                    )
    assert not wrong, "\n".join(wrong)


def _module_level(body: list[ast.stmt]) -> list[ast.stmt]:
    """Imports that run when the module is imported:
    not those in functions or under TYPE_CHECKING.
    """
    found: list[ast.stmt] = []
    for node in body:
        if isinstance(node, (ast.Import, ast.ImportFrom)):
            found.append(node)
        elif isinstance(node, ast.If) and "TYPE_CHECKING" not in ast.unparse(node.test):
            found += _module_level(node.body + node.orelse)
        elif isinstance(node, (ast.Try, ast.With, ast.ClassDef)):
            found += _module_level(node.body)
    return found


@pytest.mark.parametrize("name", ["utils", "helpers", "common", "misc"])
def test_no_module_without_a_subject(name: str) -> None:
    assert not [path for path in python_files() if path.stem == name]
