"""`kb profile check`: the file, the lists, a data root, the services."""

import json
from pathlib import Path
from typing import Any

import pytest

from tests.cli.commands.profile.conftest import (
    ERRORS,
    GOOD,
    Broken,
    Typed,
    row,
    summary_of,
    toml,
    written,
)
from tests.cli.conftest import Kb
from tests.faults import Sandbox
from tests.pairs.made import fill, tables

WARNINGS = [
    toml('["rock garden"]', '["spring"]', 4, 'the everyday word "spring"', "topic_keywords"),
    toml('["rock garden"]', '["alpines", "Alpines"]', 4, "twice"),
    toml("[26]", "[99]", 5, "99, which is not a YouTube category", "26 Howto"),
    toml("[26]", '[26]\ngame_ids = ["Gardens"]', 6, "not a browse id", "begins with UC"),
    toml("[26]", "[26]\nmin_aspect_ratio = 2", 6, "'youtube.min_aspect_ratio'", "hardly any"),
    toml("[26]", "[26]\nmax_age_days = 90", 6, "'youtube.max_age_days' is 90", "30 days"),
    toml("//gardens.wiki", "//gardens.wiki/wiki/Saxifrage", 7, "looks like a page", "the root"),
    toml("//gardens.wiki", "//wiki.example.org", 7, "the example https://wiki.example.org"),
    toml("Rock Gardens", "Minecraft", 2, "that of the profile minecraft", "your domain's own"),
    toml("[reddit]", "page_seconds = 8\n[reddit]", 8, "'wiki.page_seconds'", "settle_seconds"),
    toml("[release]", 'include = ["water"]\n[release]', 12, 'everyday word "water"', "near"),
    row("Water\tthing\n", "'Water' is an everyday word and has no rule", "near"),
    row("苔\tplace\n", "'苔' also counts inside longer words", "two signs"),
    row("石灯籠\tplace\tnear\n", "what stands between two spaces as one word", "always, or never"),
    row("Scree\tplace\t\tstone\n", "'stone' is an everyday word", "never"),
    row("Scree\tplace\ttopic\n", "'Scree' count only near other keywords", "youtube.game_ids"),
    row("saxifrage\tplace\n", "'saxifrage' is already on line 2", "the first counts"),
    row("Scree\tplace\t\t!!\n", "the form '!!' has no word"),
    row("A1\tplant\nA2\tplant\nScree\tplnt\n", "the kind 'plnt' occurs only once", "'plant'"),
]  # fmt: skip


@pytest.mark.parametrize(
    "contact",
    ["me@example.org", "you@gmail.com", "https://www.example.com/us", "a@lab.invalid", "FILL-IN"],
)
def test_a_placeholder_is_no_contact(
    contact: str, tmp_path: Path, typed: Typed, capsys: pytest.CaptureFixture[str]
) -> None:
    path = written(tmp_path)
    path.write_text(GOOD.replace("me@gardens.wiki", contact))
    assert typed("profile", "check", str(path), "--json") == 2
    (one,) = summary_of(capsys)["findings"]
    assert (one["level"], one["line"], one["key"]) == ("error", 13, "release.contact")


def test_a_placeholder_in_the_settings_is_seen_unless_all_is_local(
    tmp_path: Path,
    typed: Typed,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    path = written(tmp_path)
    monkeypatch.setenv("KB_CONTACT", "you@example.com")
    assert typed("profile", "check", str(path)) == 0  # the sandbox's services
    for name in ("KB_WIKI_URL", "KB_REDDIT_ENDPOINT", "KB_YOUTUBE_WEB", "KB_YOUTUBE_ENDPOINT"):
        monkeypatch.delenv(name, raising=False)
    assert typed("profile", "check", str(path)) == 2
    shown = capsys.readouterr().out
    assert f"{path}:\n" in shown
    assert "KB_CONTACT is the placeholder you@example.com" in shown


@pytest.mark.parametrize(
    ("spdx", "fix"),
    [("CC-BY-4", "known: "), ("MY-LICENCE", "known: CC-BY-3.0, CC-BY-4.0, ")],
)
def test_a_licence_is_one_that_a_release_can_carry(
    spdx: str, fix: str, tmp_path: Path, typed: Typed, capsys: pytest.CaptureFixture[str]
) -> None:
    path = written(tmp_path)
    path.write_text(GOOD.replace("CC-BY-4.0", spdx, 1))
    assert typed("profile", "check", str(path), "--json") == 2
    (one,) = summary_of(capsys)["findings"]
    assert one["key"] == "release.licenses.youtube"
    assert spdx in one["what"]
    assert fix in one["fix"]
    assert typed("links", "--profile", str(path), "--data", str(tmp_path)) == 1  # nothing is there


def test_an_everyday_word_that_is_meant_is_no_warning(
    typed: Typed, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    written(tmp_path, row("Water\tthing\talways\tstone\n", "", ""))
    assert typed("profile", "check", "./profile.toml", "--json") == 0
    assert "everyday" not in capsys.readouterr().out


def test_forms_that_overlap_are_shown(
    typed: Typed, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    written(tmp_path, row("Saxifrages\tplant\n", "", ""))
    assert typed("profile", "check", "./profile.toml", "--json") == 0
    (note,) = [one for one in summary_of(capsys)["findings"] if "overlap" in one["what"]]
    assert note["level"] == "note"
    assert "2 forms overlap: 'saxifrages' (Saxifrages, Saxifrage)" in note["what"]


def test_there_are_thirty() -> None:
    assert len(ERRORS) >= 30


@pytest.mark.parametrize("broken", WARNINGS, ids=lambda one: one.new[:40])
def test_what_can_hardly_be_meant_is_a_warning(
    broken: Broken, tmp_path: Path, typed: Typed, capsys: pytest.CaptureFixture[str]
) -> None:
    path = written(tmp_path, broken)
    assert typed("profile", "check", str(path), "--json") == 0
    summary = summary_of(capsys)
    found = [one for one in summary["findings"] if one["level"] == "warning"]
    (one,) = [one for one in found if broken.said in one["what"]]
    assert broken.fix in one["fix"]
    assert one["file"] == broken.file
    assert len(found) == summary["warnings"] == 1


@pytest.mark.parametrize(
    "words",
    [
        *((source, "crawl") for source in ("youtube", "wiki", "reddit")),
        *((source, "filter") for source in ("youtube", "wiki", "reddit")),
        ("reddit", "import", "RS_2024-01.zst"),
        ("youtube", "crawl", "--plan"),
        ("pairs",),
    ],
    ids=" ".join,
)
def test_a_broken_list_stops_what_goes_by_the_profile(
    words: tuple[str, ...],
    tmp_path: Path,
    typed: Typed,
    sandbox: Sandbox,
    capsys: pytest.CaptureFixture[str],
) -> None:
    path = written(tmp_path, row("Trough\n", ""))
    asked = len(sandbox.ledger.requests())
    assert typed(*words, "--profile", str(path)) == 2
    assert f"{tmp_path}/keywords.tsv:5: a line has a keyword" in capsys.readouterr().err
    assert len(sandbox.ledger.requests()) == asked


def test_a_broken_list_stops_no_command_that_has_no_use_for_it(
    tmp_path: Path, typed: Typed
) -> None:
    path = written(tmp_path, row("Trough\n", ""))
    assert typed("status", "--profile", str(path)) == 0


def test_a_warning_stops_nothing(
    tmp_path: Path, typed: Typed, capsys: pytest.CaptureFixture[str]
) -> None:
    path = written(tmp_path, row("Water\tthing\n", ""))
    assert typed("youtube", "crawl", "--plan", "--profile", str(path)) == 0
    assert capsys.readouterr().err == ""


def test_a_copied_folder_beside_the_shipped_ones_needs_its_own_name(
    tmp_path: Path, typed: Typed, capsys: pytest.CaptureFixture[str], monkeypatch: Any
) -> None:
    from kb.core import installation
    from kb.core.config import profile
    from kb.core.config.profile import check

    profiles = tmp_path / "profiles"
    (profiles / "garden").mkdir(parents=True)
    written(profiles / "garden", toml('"garden"', '"minecraft"', 1, ""))
    for module in (profile, check, installation):
        monkeypatch.setattr(module, "folder", lambda name: profiles)
    assert typed("profile", "check", "garden", "--json") == 2
    (one,) = [found for found in summary_of(capsys)["findings"] if found["level"] == "error"]
    assert "the profile's folder is garden" in one["what"]
    assert 'name = "garden"' in one["fix"]


def test_over_a_data_root_it_shows_what_each_keyword_hits(
    tmp_path: Path, kb: Kb, make_rows: Any
) -> None:
    root = tmp_path / "found"
    fill(root, *tables(40, 300, ["saxifrage", "spring", "alpine trough"], share=0.05), make_rows)
    path = written(tmp_path, row("Edelweiss\tplant\n", ""))
    before = sorted(root.rglob("*"))
    shown = kb("profile", "check", str(path), "--data", str(root), "--quiet")
    assert shown.returncode == 0, shown.stderr
    assert "[saxifrage]" in shown.stdout
    assert "1 of 4 match nothing" in shown.stdout
    assert "Edelweiss" in shown.stdout
    told = kb("profile", "check", str(path), "--data", str(root), "--json", "--quiet")
    hits = {one["keyword"]: one for one in json.loads(told.stdout)["hits"]}
    assert set(hits) == {"Saxifrage", "Spring", "Alpine Trough", "Edelweiss"}
    assert hits["Saxifrage"]["matches"] > 10
    assert hits["Spring"]["rule"] == "near:10"
    assert 1 <= len(hits["Saxifrage"]["examples"]) <= 3
    assert hits["Edelweiss"]["matches"] == 0
    assert sorted(root.rglob("*")) == before
    judged = kb("pairs", "keywords", "--profile", str(path), "--data", str(root), "--quiet")
    assert f"Saxifrage\tplant\t\t{hits['Saxifrage']['matches']}\t" in judged.stdout
    none = kb("profile", "check", str(path), "--data", "nowhere")
    assert none.returncode == 2
    assert "there is no data root" in none.stderr


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
