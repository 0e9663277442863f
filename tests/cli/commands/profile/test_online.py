"""`kb profile check --online`, against the sandbox."""

import json
from pathlib import Path
from typing import Any

import pytest

from tests.cli.commands.profile.conftest import GOOD, Typed, summary_of, written
from tests.faults import Sandbox


def test_online_asks_each_service_once_and_says_what_it_cost(
    tmp_path: Path, typed: Typed, sandbox: Sandbox, capsys: pytest.CaptureFixture[str]
) -> None:
    seen = len(sandbox.ledger.requests())
    assert typed("profile", "check", "minecraft", "--online", "--json") == 0
    summary = summary_of(capsys)
    asked = sandbox.ledger.requests()[seen:]
    assert [one.path for one in asked if one.service == "youtube"] == ["/youtube/v3/search"]
    assert [one.path for one in asked if one.service == "reddit"][1:] == ["/r/Minecraft/about/"]
    of_wiki = [one for one in asked if one.service == "wiki"]
    assert [one.args.get("meta") for one in of_wiki].count("siteinfo") == 1
    assert len(of_wiki) <= 5 + 5  # robots.txt, front page and its target, three answers; pages
    assert summary["units"] == 1
    assert summary["requests"] == len(asked)
    said = {one["file"]: one["what"] for one in summary["findings"]}
    assert "finds channels such as" in said["online: youtube"]
    assert "cost: 1 request, 1 search unit" in said["online: youtube"]
    assert "licence" in said["online: wiki"]
    assert said["online: reddit"].startswith("r/Minecraft, 8,000 subscribers")
    assert not (tmp_path / "data").exists()


def test_online_tries_the_selectors_on_pages_of_the_wiki(
    tmp_path: Path, typed: Typed, capsys: pytest.CaptureFixture[str]
) -> None:
    path = written(tmp_path)
    markup = """url = "https://gardens.wiki"
    [wiki.markup]
    root = ".no-such-root"
    recipe = ".no-such-grid"
    slot = "span:frist-child"
    sprite = "img"
    """
    path.write_text(GOOD.replace('url = "https://gardens.wiki"\n', markup))
    assert typed("profile", "check", str(path), "--online", "--json") == 2
    found = [one for one in summary_of(capsys)["findings"] if one["file"] == "wiki selectors"]
    assert [(one["level"], one["key"]) for one in found] == [
        ("error", "wiki.markup.slot"),
        ("warning", "wiki.markup.root"),
        ("warning", "wiki.markup.recipe"),
    ]
    assert "wiki.markup.sprite" not in found[2]["what"]


def test_online_says_what_is_not_there(
    tmp_path: Path, typed: Typed, capsys: pytest.CaptureFixture[str], monkeypatch: Any
) -> None:
    path = written(tmp_path)
    path.write_text(GOOD.replace('["rock garden"]', '["zzz qqq xxx"]'))
    assert typed("profile", "check", str(path), "--online", "--json") == 2
    found = {one["file"]: one for one in summary_of(capsys)["findings"]}
    assert "finds no channel" in found["online: youtube"]["what"]
    assert "r/rockgarden can't be read" in found["online: reddit"]["what"]
    assert "no subreddit of that name" in found["online: reddit"]["fix"]


def test_online_a_key_that_is_missing_and_a_service_that_is_gone(
    typed: Typed, sandbox: Sandbox, capsys: pytest.CaptureFixture[str], monkeypatch: Any
) -> None:
    monkeypatch.delenv("YOUTUBE_API_KEY")
    assert typed("profile", "check", "minecraft", "--online", "--json") == 0
    found = {one["file"]: one for one in summary_of(capsys)["findings"]}
    assert "YOUTUBE_API_KEY is not set" in found["online: youtube"]["what"]
    monkeypatch.setenv("YOUTUBE_API_KEY", "some-other-key")
    sandbox.servers["wiki"].stop()
    try:
        code = typed("profile", "check", "minecraft", "--online", "--json")
    finally:
        sandbox.servers["wiki"].start()
    found = {one["file"]: one for one in summary_of(capsys)["findings"]}
    assert "no connection" in found["online: wiki"]["what"]
    assert found["online: youtube"]["level"] == "error"  # the key is refused
    assert code == 1
    assert "some-other-key" not in json.dumps(found)
