"""Words of the data in templates."""

import json
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest
from jinja2 import UndefinedError
from markdown_it import MarkdownIt

from kb.core.licences import KNOWN
from kb.release.build import release
from kb.release.metadata.templates import render
from tests.release.conftest import a_run
from tests.release.made import build

HOSTILE = (
    "Free\n\n# Owned\n<script>alert(1)</script> | x | [here](https://evil.example) `code`"
    " *now*\u2028---"
)


def test_words_of_the_data_are_never_markup_nor_lines(tmp_path: Path) -> None:
    """A licence is what a wiki's file page says, a title and a name what a profile says."""

    def edit(name: str, made: list[dict[str, Any]]) -> None:
        if name == "wiki/images":
            made[0]["license"], made[1]["license"] = HOSTILE, "plain_words"

    profile = tmp_path / "mine.toml"
    profile.write_text(
        f'name = "mine"\ntitle = {json.dumps(HOSTILE)}\n[release]\ncontact ='
        f" {json.dumps(HOSTILE)}\n"
        f"creators = [{{ name = {json.dumps(HOSTILE)} }}]\n"
    )
    release(a_run(build(tmp_path, edit, ("wiki",)), profile))
    folder = tmp_path / "release" / "wiki"
    law = (folder / "LICENSE").read_text()
    assert "\n# Owned" not in law
    assert len([line for line in law.splitlines() if "alert(1)" in line]) == 1
    for name in ("README.md", "DATASHEET.md"):
        text = (folder / name).read_text()
        text = text[text.index("\n# ") :] if name == "README.md" else text  # YAML comes first
        page = MarkdownIt("commonmark").enable("table").parse(text)
        inside = [token for block in page for token in block.children or ()]
        assert not [token for token in (*page, *inside) if token.type.startswith("html")]
        links = [str(token.attrs["href"]) for token in inside if token.type == "link_open"]
        assert not [link for link in links if "evil" in link]
        headings = [after.content for token, after in pairwise(page) if token.tag == "h1"]
        assert "Owned" not in headings
        # Shown as they were written, in one piece: in the title, and in the table of licences.
        words = [block for block in page if "alert(1)" in block.content and block.children]
        seen = ["".join(token.content for token in block.children or ()) for block in words]
        assert any("<script>alert(1)</script> | x | [here]" in said for said in seen)
        assert "plain_words" in text
    said = MarkdownIt("commonmark").parse((folder / "README.md").read_text())
    fence = next(token for token in said if token.info == "bibtex")
    assert fence.content.count("\n") == 7


def test_a_template_with_an_unknown_name_fails() -> None:
    with pytest.raises(UndefinedError, match="'about' is undefined"):
        render("licence.txt", law=KNOWN["CC0-1.0"], facts=None)
