"""`.ci/light.txt`: the packages of `make setup LIGHT=1`."""

import importlib.metadata
import re
from pathlib import Path

from packaging.requirements import Requirement

from tests.conftest import ROOT


def needed(name: str, extra: str, seen: set[tuple[str, str]]) -> None:
    """Add a package with that extra, and all that it needs on this machine, to `seen`."""
    if (name, extra) in seen:
        return
    seen.add((name, extra))
    for wanted in map(Requirement, importlib.metadata.requires(name) or ()):
        if wanted.marker is None or wanted.marker.evaluate({"extra": extra}):
            for more in ("", *wanted.extras):
                needed(re.sub("[-_.]+", "-", wanted.name).lower(), more, seen)


def test_a_light_set_up_installs_all_that_its_extra_needs_and_nothing_heavy() -> None:
    listed = set((ROOT / ".ci" / "light.txt").read_text(encoding="utf-8").split())
    seen: set[tuple[str, str]] = set()
    for extra in ("", "light"):
        needed("lorecrawl", extra, seen)
    assert {name for name, _ in seen} - {"lorecrawl"} <= listed
    assert not listed & {"torch", "selenium", "av", "mlcroissant", "transformers", "pandas"}


def test_a_light_set_up_is_below_700_mb() -> None:
    """What `du -sm .venv` shows after it: blocks of the files of its packages, and of pip."""
    listed = {*(ROOT / ".ci" / "light.txt").read_text(encoding="utf-8").split(), "pip"}
    paths = {
        Path(str(path.locate()))
        for package in importlib.metadata.distributions()
        if re.sub("[-_.]+", "-", package.metadata["Name"]).lower() in listed
        for path in package.files or ()
        if "__pycache__" not in path.parts
        and ("discovery_cache/documents" not in str(path) or path.name == "youtube.v3.json")
    }
    size = sum(path.stat().st_blocks * 512 for path in paths if path.is_file()) / (1 << 20)
    print(f"a light .venv: {size:.0f} MB")
    assert 100 < size <= 700
