"""Every `kb …` that a message, hint or description names is a command,
and can be typed as it stands.
"""

import ast
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import pytest

from kb.cli.app import TREE
from tests.cli.test_app import COMMANDS

ROOT = Path(__file__).resolve().parents[2]
SOURCES = ("youtube", "wiki", "reddit")


class Mention(NamedTuple):
    place: str
    text: str  # without the quotes; what an f-string fills in is {}
    advised: bool  # "run `kb …`": somebody will type it
    prose: bool  # a docstring, which may speak of a whole group


def mentions() -> Iterator[Mention]:
    """Each mention, file by file; of a file without one not even the syntax is looked at."""
    for path in sorted([*ROOT.glob("kb/**/*.py"), *ROOT.glob("pipelines/*.py")]):
        text = path.read_text(encoding="utf-8")
        if "`kb " in text:
            yield from _mentions_in(path.relative_to(ROOT), ast.parse(text))


def _mentions_in(path: Path, tree: ast.AST) -> Iterator[Mention]:
    nodes = list(ast.walk(tree))
    docs = {
        id(node.value)
        for node in nodes
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant)
    }
    parts = {
        id(value) for node in nodes if isinstance(node, ast.JoinedStr) for value in node.values
    }
    for node in nodes:
        text = "" if id(node) in parts else text_of(node)
        for found in re.finditer(r"`kb ([a-z<{-][^`]*)`", text):
            place = f"{path}:{getattr(node, 'lineno', 0)}"
            advised = bool(re.search(r"\brun `", text[: found.start() + 1]))
            yield Mention(place, found[1], advised, id(node) in docs)


def text_of(node: ast.AST) -> str:
    if isinstance(node, ast.Constant) and isinstance(node.value, str):
        return node.value
    if isinstance(node, ast.JoinedStr):
        return "".join(text_of(part) or "{}" for part in node.values)
    return ""


def command(words: list[str]) -> Any:
    """The command that the words name; a whole group has None."""
    path = " ".join(words[:2])
    return COMMANDS.get(path) or COMMANDS.get(words[0] if words else "")


def problems(mention: Mention) -> list[str]:
    words = re.sub(r"<source>|youtube\|reddit", "{}", mention.text).split()
    if "{}" in words[:2] and words not in (["{}"], ["{}", "{}"]):
        each = [[word.replace("{}", source) for word in words] for source in SOURCES]
        found = [problems_of(one, mention) for one in each if command(one) is not None]
        return min(found, default=["is no command of any source"], key=len)
    return problems_of(words, mention)


def problems_of(words: list[str], mention: Mention) -> list[str]:
    if words[0] in ("{}", "--help", "help"):
        return []
    found = command(words)
    if found is None:
        whole = mention.prose and len(words) == 1 and words[0] in TREE
        return [] if whole else ["is no command"]
    options = {name: p for p in found.params for name in p.opts if name.startswith("--")}
    said = []
    depth = 2 if " ".join(words[:2]) in COMMANDS else 1
    takes_words = any(p.param_type_name == "argument" for p in found.params)
    for number, word in enumerate(words):
        if word.startswith("--") and word != "--help":
            option = options.get(word)
            if option is None:
                said.append(f"has no {word}")
            elif not (option.is_flag or mention.prose or words[number + 1 : number + 2]):
                said.append(f"{word} needs a value")
        elif number >= depth and word.isalpha() and words[number - 1] not in options:
            said += [] if takes_words else [f"takes no argument {word}"]
    needed = [p for p in found.params if p.required and p.param_type_name == "argument"]
    if mention.advised and needed and len(words) == depth:
        said.append(f"needs {needed[0].name}")
    return said


def test_every_command_that_is_named_exists_as_it_stands() -> None:
    found = list(mentions())
    assert len(found) > 80
    assert sum(mention.advised for mention in found) > 25
    assert [(one.place, one.text, said) for one in found if (said := problems(one))] == []


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("pairs filter", "takes no argument filter"),
        ("annotate", "is no command"),
        ("youtube export --limit 3", "has no --limit"),
        ("pairs --from-index", "--from-index needs a value"),
        ("reddit import", "needs files"),
        ("filter", "is no command"),
        ("{} fliter", "is no command of any source"),
    ],
)
def test_what_is_wrong_would_be_seen(text: str, problem: str) -> None:
    assert problems(Mention("", text, advised=True, prose=False)) == [problem]
