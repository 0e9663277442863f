"""One formatter, one linter and one type checker over everything, and nothing left to mend."""

from __future__ import annotations

import re
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent


@pytest.mark.parametrize("words", [("check",), ("format", "--check")], ids=" ".join)
def test_nothing_is_left_to_mend(words: tuple[str, ...]) -> None:
    done = subprocess.run(
        [sys.executable, "-m", "ruff", *words, "--no-cache", "."],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr


@pytest.mark.timeout(900)  # minutes without .mypy_cache, seconds with it
def test_every_type_is_right() -> None:
    done = subprocess.run(
        [sys.executable, "-m", "mypy"], cwd=ROOT, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stdout + done.stderr


def test_what_is_imported_is_read_for_its_types() -> None:
    """mypy leaves out what others import: once we do, its names would be of any type."""
    settings = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["mypy"]
    left_out = [
        name.removesuffix(".*")
        for part in settings["overrides"]
        if part.get("follow_imports") == "skip"
        for name in part["module"]
        if not name.startswith(("torch.", "transformers.", "pyarrow."))  # said there
    ]
    assert "hypothesis" in left_out
    imported = {
        found
        for folder in ("kb", "pipelines")
        for path in (ROOT / folder).rglob("*.py")
        for pair in re.findall(
            r"(?m)^ *(?:from|import) ([\w.]+)(?: import (\w+))?", path.read_text()
        )
        for found in (pair[0], ".".join(pair))
    }
    assert "numpy" in imported
    assert not [
        (name, found)
        for name in left_out
        for found in imported
        if found == name or found.startswith(f"{name}.")
    ]
