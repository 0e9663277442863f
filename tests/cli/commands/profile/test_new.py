"""`kb profile new` and the group `kb profile`."""

import json
import re
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from kb.core.config.profile import load_profile
from kb.core.config.profile.check import check_file
from kb.core.config.profile.new import KEYWORDS, profile_text
from kb.core.config.section import ERROR
from kb.core.installation import folder
from kb.pairs.keywords import NEVER, Keyword, read_keywords
from tests.cli.commands.profile.conftest import (
    ERRORS,
    GOOD,
    HEADER,
    Broken,
    Typed,
    summary_of,
    written,
)
from tests.cli.conftest import Kb, clean_environment
from tests.core.config.profile.test_new import filled
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


ROOT = Path(__file__).resolve().parents[4]


def test_new_then_four_lines_then_a_clean_check_then_a_plan(tmp_path: Path, kb: Kb) -> None:
    made = kb("profile", "new", "rock-gardens")
    assert made.returncode == 0, made.stderr
    commands = re.findall(r"^  kb (.*)$", made.stdout, re.MULTILINE)
    assert [words.split()[0] for words in commands] == ["profile", "demo", "youtube"]
    here = tmp_path / "rock-gardens"
    assert sorted(path.name for path in here.iterdir()) == ["keywords.tsv", "profile.toml"]

    open_ = kb(*commands[0].split(), "--json")
    assert open_.returncode == 2
    findings = json.loads(open_.stdout)["findings"]
    errors = [one for one in findings if one["level"] == "error"]
    assert {one["key"] for one in errors} == {
        "youtube.category_ids",
        "wiki.url",
        "reddit.subreddit",
        "",
    }
    assert all("still to be filled in" in one["what"] for one in errors)
    assert not [one for one in findings if one["level"] == "warning"]
    for one in errors:  # and they are where the check says
        lines = (here / one["file"]).read_text().splitlines()
        assert "FILL-IN" in lines[one["line"] - 1]

    for path in here.iterdir():
        path.write_text(filled(path.read_text()))
    clean = kb(*commands[0].split())
    assert clean.returncode == 0, clean.stdout
    assert "0 errors" in clean.stdout
    assert "warning" not in clean.stdout
    plan = kb(*commands[2].split())
    assert plan.returncode == 0, plan.stderr
    assert not (tmp_path / "data").exists()


@pytest.mark.parametrize(
    "name", sorted(path.name for path in folder("profiles").iterdir() if path.is_dir())
)
def test_from_another_profile_its_values_are_taken(name: str, tmp_path: Path, kb: Kb) -> None:
    made = kb("profile", "new", "mine", "--from", name)
    assert made.returncode == 0, made.stderr
    mine, theirs = load_profile(tmp_path / "mine" / "profile.toml"), load_profile(name)
    assert mine.name == "mine"
    owners = {"release": {"licenses", "creators", "contact"}}  # who releases it is for them to say
    assert mine.model_dump(exclude={"name": True, **owners}) == theirs.model_dump(
        exclude={"name": True, **owners}
    )
    assert mine.release.unlicensed()
    assert mine.release.unsigned() == ["a creator", "a contact"]
    for listed in theirs.pairs.keyword_files:
        assert (tmp_path / "mine" / listed).read_bytes() == theirs.resolve_file(listed).read_bytes()
    found = check_file(mine.path).findings
    assert not [one for one in found if one.level == ERROR]


def test_from_a_profile_without_a_source(tmp_path: Path, kb: Kb) -> None:
    (tmp_path / "small.toml").write_text(
        'name = "small"\ntitle = "Small"\n[reddit]\nsubreddit = "small"\n'
    )
    made = kb("profile", "new", "mine", "--from", "small.toml", "--wiki", "https://small.wiki/")
    assert made.returncode == 0, made.stderr
    mine = load_profile(tmp_path / "mine" / "profile.toml")
    assert (mine.youtube, mine.pairs) == (None, None)
    assert (mine.wiki.url, mine.reddit.subreddit) == ("https://small.wiki", "small")
    assert not (tmp_path / "mine" / "keywords.tsv").exists()


def test_an_address_and_a_subreddit_are_filled_in(tmp_path: Path, kb: Kb) -> None:
    made = kb(
        "profile", "new", "g", "--wiki", "https://g.wiki", "--subreddit", "gg", "--out", "x/y"
    )
    assert made.returncode == 0, made.stderr
    text = (tmp_path / "x" / "y" / "profile.toml").read_text()
    assert 'wiki.url = "https://g.wiki"' in text
    assert 'reddit.subreddit = "gg"' in text
    assert "kb profile check x/y/profile.toml" in made.stdout


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (
            ("Rock Gardens",),
            (
                "invalid profile name 'Rock Gardens': use only lower-case letters, digits, - and _;"
                " write rock-gardens"
            ),
        ),
        (("g", "--wiki", "g.wiki"), "--wiki is 'g.wiki'; must be an address like"),
        (("g", "--subreddit", "r/gg"), "--subreddit is 'r/gg'; must be: name without r/"),
        (("g", "--from", "minecarft"), "there is no profile 'minecarft'"),
        (("g", "--out", "there"), "there/keywords.tsv already exists, and is not overwritten"),
    ],
)  # fmt: skip
def test_what_is_refused_leaves_nothing(
    words: tuple[str, ...], said: str, tmp_path: Path, kb: Kb
) -> None:
    (tmp_path / "there").mkdir()
    (tmp_path / "there" / "keywords.tsv").write_text("mine")
    done = kb("profile", "new", *words)
    assert done.returncode == 2
    assert said in done.stderr
    assert [path.name for path in tmp_path.rglob("*")] == ["there", "keywords.tsv"]
    assert (tmp_path / "there" / "keywords.tsv").read_text() == "mine"


def test_in_a_checkout_it_goes_beside_the_shipped_ones(tmp_path: Path) -> None:
    """A copy of the checkout's files that are looked at; nothing is written into this one."""
    for part in ("kb", "schemas", "pipelines", "data/profiles"):
        shutil.copytree(ROOT / part, tmp_path / part, ignore=shutil.ignore_patterns("__pycache__"))
    shutil.copy(ROOT / "pyproject.toml", tmp_path)

    def kb(*words: str) -> subprocess.CompletedProcess[str]:
        return subprocess.run(
            [sys.executable, "-m", "kb", *words],
            cwd=tmp_path,
            env=clean_environment() | {"PYTHONPATH": str(tmp_path)},
            capture_output=True,
            text=True,
            check=False,
        )

    made = kb("profile", "new", "rock-gardens")
    assert made.returncode == 0, made.stderr
    assert (tmp_path / "data" / "profiles" / "rock-gardens" / "profile.toml").is_file()
    assert "kb profile check rock-gardens\n" in made.stdout
    assert kb("profile", "check", "rock-gardens").returncode == 2
    assert kb("profile", "new", "rock-gardens").returncode == 2
    with Sandbox(services=["youtube"]):
        refused = kb("youtube", "crawl", "--profile", "rock-gardens")
    assert refused.returncode == 2
    assert "still to be filled in" in refused.stderr


def test_the_list_says_what_its_reader_does(tmp_path: Path) -> None:
    """The examples in its comments are rows that mean what they say."""
    examples = re.findall(r"^#   (\w+)  +(\w+)  +(near)?  +(\w.*)$", KEYWORDS, re.MULTILINE)
    assert len(examples) == 2
    rows = "".join("\t".join(cells) + "\n" for cells in examples)
    path = tmp_path / "keywords.tsv"
    text = KEYWORDS.replace("FILL-IN\tkind\n", rows + "Soil\tthing\tnever\nPeat\tthing\tnear:30\n")
    path.write_text(text, encoding="utf-8-sig")  # as an editor of Windows saves it
    assert read_keywords(path, 20) == [
        Keyword("Secateurs", "tool", None, ("pruning shears", "pruners")),
        Keyword("Bed", "place", 20, ("flower bed",)),
        Keyword("Soil", "thing", NEVER),
        Keyword("Peat", "thing", 30),
    ]


def test_no_word_of_another_domain_stands_in_it() -> None:
    both = profile_text("rock-gardens") + KEYWORDS
    assert not re.search(r"minecraft|\bgames?\b|\bmobs?\b|\bplayers?\b", both, re.IGNORECASE)
