"""No shared room names a source: what is special about one is declared, or a method of its class.

Docstrings and comments may give examples. What is left stands in LEFT, with its reason.
"""

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.test_arrows import ROOT, parsed, python_files

ROOMS = {"annotate", "artifacts", "core", "crawl", "explore", "filters", "links", "look", "mcp"}
ROOMS |= {"net", "query", "release", "report", "schema", "search", "store", "verify"}
NAMED = re.compile(r"(?i)(?<![a-z])(youtube|wiki|reddit)(?![a-z])")
LEFT = {
    "kb/core/config/profile/new.py": "an example in the text of a keyword list",
    "kb/core/config/profile/release.py": "help of settings, with an example",
    "kb/core/config/settings.py": "the settings that Lorecrawl itself has",
    "kb/core/summary/vocabulary.py": "what the numbers of the shipped commands count",
    "kb/schema/video_facts.py": "names of files as yt-dlp writes them",
    "kb/store/artifact_registry.py": "what `kb reddit reconstruct` writes",
    "kb/links/build.py": "an entity's own page, a column of links/entities",
    "kb/artifacts/table_catalog.py": "where `kb reddit reconstruct` writes",
}


def texts(tree: ast.Module) -> Iterator[tuple[int, str]]:
    """(line, text) of the strings of a module that are no docstrings, and of names of fields."""
    owners = (ast.Module, ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef)
    plain = {
        id(statement.value)
        for node in ast.walk(tree)
        if isinstance(node, owners)
        for statement in node.body
        if isinstance(statement, ast.Expr)
    }
    for node in ast.walk(tree):
        match node:
            case ast.Constant(value=str(text)) if id(node) not in plain:
                yield node.lineno, text
            case ast.Attribute(attr=text) | ast.AnnAssign(target=ast.Name(id=text)):
                yield node.lineno, text


def naming(root: Path) -> dict[str, list[str]]:
    """The strings of shared rooms that name a source, by file."""
    named: dict[str, list[str]] = {}
    for path in python_files(root):
        file = str(path.relative_to(root))
        if path.relative_to(root).parts[1] in ROOMS:
            for line, text in texts(parsed(path)):
                if NAMED.search(text):
                    named.setdefault(file, []).append(f"{file}:{line} has {text[:60]!r}")
    return named


def test_no_shared_room_names_a_source() -> None:
    named = naming(ROOT)
    wrong = [line for file, lines in named.items() if file not in LEFT for line in lines]
    assert not wrong, "\n".join(wrong)
    assert not LEFT.keys() - named.keys(), "these name none anymore: take them out of LEFT"


@pytest.mark.parametrize(
    "code",
    [
        'if source == "wiki": ...',
        'rows("youtube/videos")',
        'table = "reddit_posts"',
        'hint = f"run `kb reddit crawl --data {root}`"',
        "class Limits:\n    reddit: int = 5\n",
        "limit = profile.wiki.min_words",
        'def late(kinds=("clean.wiki",)):\n    "youtube"\n',
    ],
)
def test_a_planted_name_is_reported(tmp_path: Path, code: str) -> None:
    place = tmp_path / "kb/filters/planted.py"
    place.parent.mkdir(parents=True)
    place.write_text(f'"""An example: youtube."""\n\n{code}\n')
    assert len(naming(tmp_path)["kb/filters/planted.py"]) == 1
