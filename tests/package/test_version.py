"""The version stands in one place, and whatever names it names that one."""

import importlib.metadata
import re

import kb
from tests.conftest import ROOT


def test_the_installed_package_and_the_changelog_have_the_version_of_the_code() -> None:
    assert importlib.metadata.version("lorecrawl") == kb.__version__
    changelog = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    released = re.findall(r"^## \[(\d+\.\d+\.\d+)\] - \d{4}-\d\d-\d\d$", changelog, re.MULTILINE)
    assert released[0] == kb.__version__
    declared = (ROOT / "pyproject.toml").read_text(encoding="utf-8")
    assert not re.search(r"^version = ", declared, re.MULTILINE)
