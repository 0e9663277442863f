"""The shipped sources use nothing that a package of someone else's can't."""

import re
from collections.abc import Iterable, Iterator
from pathlib import Path

import pytest

from tests.test_arrows import ALLOWED, ROOT, imported, parsed, python_files

SHIPPED = ("youtube", "wiki", "reddit")
PACKAGE = ROOT / "tests/fourth/package"
TOP = ("kb/registry.py", "kb/cli/", "pipelines/", "kb/sandbox/")


def named_in_the_guide(words: str) -> set[str]:
    """The rooms in the guide's sentence that begins with these words."""
    guide = (ROOT / "docs/new-source.md").read_text(encoding="utf-8")
    (sentence,) = re.findall(rf"{re.escape(words)}.*?\.(?:\s|$)", guide, re.DOTALL)
    return set(re.findall(r"`kb\.(\w+)`", sentence))


def names_of_lorecrawl(files: Iterable[Path]) -> Iterator[tuple[str, list[str]]]:
    """(file:line, parts of the imported name), but for what a source has in its own room."""
    for path in files:
        own = path.relative_to(ROOT).parts[1]
        for line, module in imported(parsed(path), path):
            parts = module.split(".")
            if parts[0] == "kb" and parts[1:2] != [own]:
                yield f"{path.relative_to(ROOT)}:{line} imports {module}", parts


@pytest.mark.parametrize("source", [*(ROOT / "kb" / name for name in SHIPPED), PACKAGE])
def test_sources_import_from_open_rooms_alone(source: Path) -> None:
    """The guide lists them; a name with an underscore belongs to its module."""
    files = [path for path in source.rglob("*.py") if path.name != "pipeline.py"]
    allowed = named_in_the_guide("A package may import")
    wrong = [
        place
        for place, (_, room, *names) in names_of_lorecrawl(files)
        if room not in allowed or any(re.match("_[a-z]", name) for name in names)
    ]
    assert not wrong, "\n".join(wrong)


def test_recipes_of_sources_import_from_open_rooms_alone() -> None:
    recipes = [*(ROOT / f"pipelines/{name}.py" for name in SHIPPED), *PACKAGE.rglob("pipeline.py")]
    allowed = named_in_the_guide("A package may import") | named_in_the_guide("Its recipe")
    wrong = [
        place
        for place, (_, room, *_) in names_of_lorecrawl(recipes)
        if room not in allowed and f"pipelines/{room}.py" != place.partition(":")[0]
    ]
    assert not wrong, "\n".join(wrong)


def test_the_guide_lists_what_the_arrows_allow() -> None:
    allowed = named_in_the_guide("A package may import")
    assert [ALLOWED[name] for name in SHIPPED] == [allowed] * 3


def test_nothing_but_the_top_imports_a_shipped_source() -> None:
    """What a room below needs of a source is a declaration or a method of its class."""
    rooms = [path for path in python_files() if path.relative_to(ROOT).parts[1] not in SHIPPED]
    wrong = [
        place
        for place, (_, room, *_) in names_of_lorecrawl(rooms)
        if room in SHIPPED and not place.startswith(TOP)
    ]
    assert not wrong, "\n".join(wrong)
