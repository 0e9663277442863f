"""Tests of `kb.core.config.profile.check`."""

import pytest

from kb.core.config.profile import load_profile
from kb.core.config.profile.check import check_file
from kb.core.config.profile.check_finding import ERROR
from kb.core.errors import ProfileError


def test_tables_nested_without_end_are_one_line(tmp_path):
    path = tmp_path / "mine.toml"
    path.write_text("x = " + "[" * 100_000, encoding="utf-8")
    with pytest.raises(ProfileError, match=r"nested too deeply|not valid TOML"):
        load_profile(path)
    (finding,) = check_file(path).findings
    assert finding.level == ERROR
