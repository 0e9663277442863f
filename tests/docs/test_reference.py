"""Reference pages are made from what they describe; here they are held against it."""

import os
import re
import subprocess
from pathlib import Path

import pytest

from kb.core.config.settings import Settings
from tests.docs import reference

ROOT = Path(__file__).resolve().parents[2]


@pytest.mark.parametrize("name", reference.pages())
def test_a_page_is_what_would_be_made_now(name: str) -> None:
    assert (ROOT / name).read_text(encoding="utf-8") == reference.pages()[name], (
        f"{name} is out of date: make reference"
    )


def test_every_setting_is_described_and_in_the_example() -> None:
    example = (ROOT / ".env.example").read_text(encoding="utf-8")
    names = {name.upper() for name in Settings.model_fields}
    assert set(re.findall(r"^#?([A-Z][A-Z0-9_]+)=", example, re.MULTILINE)) == names
    assert all(field.description for field in Settings.model_fields.values())


def test_the_example_changes_nothing_as_it_is() -> None:
    """A copy of it without a value filled in must behave like no file at all."""
    values = re.findall(
        r"^([A-Z][A-Z0-9_]+)=(.*)$",
        (ROOT / ".env.example").read_text(encoding="utf-8"),
        re.MULTILINE,
    )
    assert all(value == "" for _, value in values)


def test_every_key_of_a_profile_is_described() -> None:
    empty = [
        line for line in reference.profile_keys().splitlines() if re.match(r"\| `.*\|  \|$", line)
    ]
    assert not empty, "\n".join(empty)


def test_every_make_target_is_in_make_help() -> None:
    text = (ROOT / "Makefile").read_text(encoding="utf-8")
    targets = set(re.findall(r"^([a-z-]+):", text, re.MULTILINE))
    described = set(re.findall(r"^([a-z-]+):.*## \S", text, re.MULTILINE))
    for_developers = set(re.findall(r"^([a-z-]+):.* # \S", text, re.MULTILINE))
    assert targets == described | for_developers
    guide = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
    assert [name for name in for_developers if not re.search(rf"make .*\b{name}\b", guide)] == []
    wanted = {
        "setup",
        "demo",
        "models",
        "annotate",
        "pairs",
        "links",
        "release",
        "report",
        "status",
        "test",
        "bench",
        "reddit-import",
        "reddit-reconstruct",
        *(
            f"{source}-{step}"
            for source in ("youtube", "wiki", "reddit")
            for step in ("crawl", "filter", "export")
        ),
    }
    assert wanted <= targets


def test_an_unknown_make_target_is_one_clear_line_before_any_set_up(tmp_path: Path) -> None:
    done = subprocess.run(
        ["make", "-f", str(ROOT / "Makefile"), "youtube-crwal"],
        cwd=tmp_path,
        # As typed, also where `make test` runs this.
        env={name: value for name, value in os.environ.items() if "MAKE" not in name},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 2
    assert done.stderr.splitlines()[0] == (
        "make: there is no target 'youtube-crwal'; make help lists them"
    )
    assert done.stdout == ""
    assert list(tmp_path.iterdir()) == []
