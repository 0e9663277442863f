"""`kb profile check` as it is typed."""

from pathlib import Path
from typing import Any

import pytest

from tests.cli.commands.profile.conftest import (
    ERRORS,
    GOOD,
    HEADER,
    Broken,
    Typed,
    summary_of,
    written,
)
from tests.faults import Sandbox


def place_of(finding: dict[str, Any]) -> str:
    return f"{finding['file']}:{finding['line']}" if finding["line"] else finding["file"]


def test_a_good_profile_has_nothing_to_mend(
    tmp_path: Path, typed: Typed, capsys: pytest.CaptureFixture[str]
) -> None:
    path = written(tmp_path)
    assert typed("profile", "check", str(path)) == 0
    out = capsys.readouterr().out
    assert out == f"{path}: no problems found\nprofile check: 0 errors\n"


@pytest.mark.parametrize("broken", ERRORS, ids=lambda one: one.new[:40])
def test_a_broken_one_has_its_one_message_and_sends_nothing(
    broken: Broken,
    tmp_path: Path,
    typed: Typed,
    sandbox: Sandbox,
    capsys: pytest.CaptureFixture[str],
) -> None:
    path = written(tmp_path, broken)
    asked = len(sandbox.ledger.requests())
    assert typed("profile", "check", str(path), "--online", "--json") == 2
    summary = summary_of(capsys)
    (one,) = [found for found in summary["findings"] if found["level"] == "error"]
    assert place_of(one) == broken.where.removesuffix(":0")
    assert broken.said in one["what"]
    assert broken.fix in one["fix"]
    assert summary["errors"] == 1
    for command in (("youtube", "crawl"), ("wiki", "filter"), ("pairs",)):
        assert typed(*command, "--profile", str(path)) == 2
        line = capsys.readouterr().err
        assert line.count("\n") == 1
        assert "kb profile check" in line
    assert len(sandbox.ledger.requests()) == asked
    assert not (tmp_path / "data").exists()


def test_everything_is_told_at_once(
    tmp_path: Path, typed: Typed, capsys: pytest.CaptureFixture[str]
) -> None:
    """Also what a wrong key beside it could hide: ranges, thresholds, the rows of the list."""
    path = written(tmp_path)
    text = GOOD.replace("[26]", '["x"]\nmin_views = 30_000_000_000').replace('title = "Rock', "")
    text = text.replace(' Gardens"', "").replace("subreddit", "subredit")
    path.write_text(text.replace("[release]", "min_tokens = 70\nmax_tokens = 60\n[release]"))
    (tmp_path / "keywords.tsv").write_text(HEADER + "Rose\nLily\tplant\tnver\n")
    assert typed("profile", "check", str(path), "--json") == 2
    errors = [one for one in summary_of(capsys)["findings"] if one["level"] == "error"]
    keys = {one["key"] for one in errors if one["file"] == "profile.toml"}
    assert keys == {
        "title",
        "youtube.category_ids[1]",
        "youtube.min_views",
        "reddit.subredit",
        "reddit.subreddit",
        "pairs",
    }
    assert [place_of(one) for one in errors if one["file"] == "keywords.tsv"] == [
        "keywords.tsv:2",
        "keywords.tsv:3",
    ]
