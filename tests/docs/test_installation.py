"""How to install the software: no text names a package of an index, as Lorecrawl is in none.

Whoever registered such a name there would be installed by our readers.
"""

import re
from pathlib import Path

import pytest

from kb.cli.app import context, leaves
from kb.core.installation import install_extra
from tests.docs import reference

ROOT = Path(__file__).resolve().parents[2]
# `pip install` of anything but the checkout itself, or our name (or the former one) as a
# requirement: lorecrawl[wiki], lorecrawl==0.1.0.
FROM_AN_INDEX = re.compile(
    r"(?:pip|uv|pipx) (?:tool )?install (?!-e )|\blore(?:crawl|base) ?(?:\[\w|[=<>~]=)",
    re.IGNORECASE,
)
WRITTEN = [
    ROOT / "README.md",
    ROOT / "CONTRIBUTING.md",
    ROOT / "CHANGELOG.md",
    *ROOT.glob("docs/*.md"),
    *ROOT.glob("docs/*.ipynb"),
    *ROOT.glob("kb/**/*.py"),
    *ROOT.glob("kb/**/*.jinja"),
    *ROOT.glob("kb/**/*.toml"),
    *ROOT.glob("pipelines/*.py"),
    *ROOT.glob("data/profiles/**/*.toml"),
    *ROOT.glob("schemas/*.md"),
    ROOT / ".env.example",
    ROOT / "Makefile",
]


def installs(text: str) -> list[str]:
    return [text[match.start() : match.end() + 40] for match in FROM_AN_INDEX.finditer(text)]


def test_no_document_or_message_installs_from_an_index() -> None:
    assert len(WRITTEN) > 300
    wrong = {path.name: installs(path.read_text(encoding="utf-8")) for path in WRITTEN}
    assert {name: lines for name, lines in wrong.items() if lines} == {}


def test_no_help_or_reference_page_installs_from_an_index() -> None:
    for name, command in leaves():
        shown = command.get_help(context(name, command))
        assert installs(shown) == [], name
    assert all(installs(text) == [] for text in reference.pages().values())


def test_no_file_of_a_release_installs_from_an_index(demo: Path) -> None:
    release = demo / "data" / "demo" / "release"
    texts = [path for path in release.rglob("*") if path.suffix in (".md", ".cff", ".json", "")]
    names = {path.name for path in texts}
    assert {"README.md", "DATASHEET.md", "CITATION.cff", "zenodo.json", "LICENSE"} <= names
    for path in texts:
        if path.is_file():
            assert installs(path.read_text(encoding="utf-8")) == [], path


@pytest.mark.parametrize(
    "text",
    [
        "pip install 'lorecrawl[wiki]'",
        "install lorecrawl[pairs]",
        'pip install "lorebase==0.1.0"',
        "uv tool install lorecrawl",
        "python -m pip install pillow",
    ],
)
def test_an_index_would_be_seen(text: str) -> None:
    assert installs(text)


def test_an_extra_is_installed_from_the_checkout() -> None:
    assert install_extra("wiki").endswith('or `pip install -e ".[wiki]"` there')
    assert installs(install_extra("wiki") + install_extra()) == []
