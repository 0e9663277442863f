"""`kb profile new` and `check`, and the check that crawls, filters and pairs run before
anything.
"""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

import pytest

from kb.cli import main
from kb.sandbox.server import Sandbox
from tests.cli.conftest import Kb, clean_environment
from tests.pairs.made import fill, tables
from tests.reddit.conftest import small_world

GOOD = """\
name = "garden"
title = "Rock Gardens"
[youtube]
keywords = ["rock garden"]
category_ids = [26]
[wiki]
url = "https://gardens.wiki"
[reddit]
subreddit = "rockgarden"
[pairs]
keyword_files = ["keywords.tsv"]
[release]
contact = "me@gardens.wiki"
creators = [{ name = "Doe, Jane" }]
"""
HEADER = "keyword\tkind\trule\tforms\n"
LIST = HEADER + "Saxifrage\tplant\nAlpine Trough\tplace\nSpring\tseason\tnear:10\tspringtime\n"


class Broken(NamedTuple):
    """Text of a file replaced; what is said, and where."""

    file: str
    old: str
    new: str
    where: str
    said: str
    mend: str


def toml(old: str, new: str, line: int, said: str, mend: str = "") -> Broken:
    return Broken("profile.toml", old, new, f"profile.toml:{line}", said, mend)


def row(text: str, said: str, mend: str = "") -> Broken:
    """A row more at the end of the list."""
    return Broken("keywords.tsv", LIST, LIST + text, "keywords.tsv:5", said, mend)


def file(text: str, where: str, said: str, mend: str = "") -> Broken:
    return Broken("keywords.tsv", LIST, text, where, said, mend)


CONTACT = 'contact = "me@gardens.wiki"'
ERRORS = [
    toml('title = "Rock Gardens"', "title = Rock Gardens", 2, "not valid TOML", "in quotes"),
    toml('title = "Rock Gardens"', 'title = "Rock', 2, "not valid TOML: a text is not closed"),
    toml("[wiki]", "keywords = []\n[wiki]", 6, "stands here a second time", "take one"),
    toml("[wiki]", "[youtube]\n[wiki]", 6, "the section stands here a second time", "together"),
    toml("[26]", "[26]\nmin_vews = 5", 6, "unknown key 'youtube.min_vews'", "'min_views'"),
    toml("[wiki]", "[wikis]", 6, "unknown key 'wikis'", "did you mean 'wiki'?"),
    toml('title = "Rock Gardens"\n', "", 0, "'title' is missing", "add a line title ="),
    toml('url = "https://gardens.wiki"\n', "", 6, "'wiki.url' is missing", "add a line wiki.url"),
    toml('["rock garden"]', '"rock garden"', 4, "'youtube.keywords' is", "a list in brackets"),
    toml("[26]", "[26]\nmin_views = -1", 6, "'youtube.min_views' is -1", "at least 0"),
    toml("[26]", '["Howto"]', 5, "'youtube.category_ids[1]' is", "a whole number"),
    toml("[26]", '["FILL-IN"]', 5, "'youtube.category_ids' is still to be filled in"),
    toml('["rock garden"]', '["FILL-IN"]', 4, "'youtube.keywords' is still to be filled in"),
    toml('"rockgarden"', '"r/rockgarden"', 9, '"r/rockgarden"', 'without r/: "rockgarden"'),
    toml('"rockgarden"', '"https://reddit.com/r/alpines/"', 9, "/alpines", 'r/: "alpines"'),
    toml('"https://gardens.wiki"', '"gardens.wiki"', 7, "'wiki.url' is", "an address like"),
    toml('"https://gardens.wiki"', '"https://gardens"', 7, "host is not a full name", "an address"),
    toml("//gardens.wiki", "//gardens.wiki/api.php", 7, "which is no root", '//gardens.wiki"'),
    toml("[reddit]", 'hosts = ["https://a.b/c"]\n[reddit]', 8, "no host", 'write "a.b"'),
    toml("[26]", "[26]\nmin_duration_s = 1e6", 6, "nothing passes", "12 hours"),
    toml("[26]", "[26]\nmin_aspect_ratio = 16", 6, "nothing passes", "wide-screen is 1.78"),
    toml("[reddit]", '[wiki.markup]\nslot = ".a["\n[reddit]', 9, ".a[", "must be a CSS selector"),
    toml("[reddit]", '[wiki.markup]\nroot = "#a >"\n[reddit]', 9, "#a >", "before its last part"),
    toml('"rockgarden"', '"rockgarden"\nmin_score = 2_000_000', 10, "nothing passes", "points"),
    toml('"rockgarden"', '"rockgarden"\nspans = ["weekly"]', 10, "'reddit.spans'", "allowed: all"),
    toml("[release]", "min_clip_s = 20\n[release]", 10, "min_clip_s is above max_clip_s"),
    toml("[release]", "min_tokens = 70\nmax_tokens = 60\n[release]", 10, "min_tokens is above"),
    toml("[release]", "[toxicity.thresholds]\nreddit = 0\n[release]", 13, "nothing passes"),
    toml("[reddit]", "max_page_height = 1000\n[reddit]", 8, "nothing passes", "the window"),
    toml(CONTACT, 'contact = "me"', 13, "no mail or web address", "such as"),
    toml('"garden"', '"minecraft"', 1, "that of the shipped profile", "a name of its own"),
    toml('"garden"', '"My Garden"', 1, "'name' is \"My Garden\"", "short name"),
    Broken(
        "profile.toml", '"keywords.tsv"', '"words.tsv"', "words.tsv", "can't be read: No such", ""
    ),
    row("Trough\n", "a line has a keyword, a kind", "this one has no tab"),
    row("Trough\tplace\t\tbasin\tsink\n", "a line has a keyword", "5 columns; commas separate"),
    row("\tplace\n", "a line has a keyword", "the keyword of this one is empty"),
    row("Trough\t\tnear\n", "a line has a keyword", "the kind of this one is empty"),
    row("Trough\tplace\tnaer\n", "the rule is 'naer'", "did you mean near?"),
    row("Trough\tplace\tnear:\n", "the rule is 'near:'", "such as near:30"),
    row("Trough\tplace\tnear:0\n", "the rule is 'near:0'", "a number of words"),
    row("?!\tplace\n", "the keyword '?!' has no word"),
    row(f"{'very ' * 20}long\tplace\n", "has more than 64 letters"),
    row("FILL-IN\tplace\n", "the line is still to be filled in"),
    file("Saxifrage\tplant\n", "keywords.tsv:1", "the first line must read keyword, kind"),
    file("keyword,kind,rule,forms\nA,b\n", "keywords.tsv:1", "the first line", "put tabs"),
    file(HEADER, "keywords.tsv", "the list holds no keyword"),
    file(HEADER + "Spring\tseason\tnear\n", "keywords.tsv:2", "every keyword has a rule"),
]  # fmt: skip
WARNINGS = [
    toml('["rock garden"]', '["spring"]', 4, 'the everyday word "spring"', "topic_keywords"),
    toml('["rock garden"]', '["alpines", "Alpines"]', 4, "twice"),
    toml("[26]", "[99]", 5, "99, which is no category", "26 Howto"),
    toml("[26]", '[26]\ngame_ids = ["Gardens"]', 6, "no browse id", "begins with UC"),
    toml("[26]", "[26]\nmin_aspect_ratio = 2", 6, "'youtube.min_aspect_ratio'", "hardly one"),
    toml("[26]", "[26]\nmax_age_days = 90", 6, "'youtube.max_age_days' is 90", "30 days"),
    toml("//gardens.wiki", "//gardens.wiki/wiki/Saxifrage", 7, "looks like a page", "the root"),
    toml("//gardens.wiki", "//wiki.example.org", 7, "the example https://wiki.example.org"),
    toml("Rock Gardens", "Minecraft", 2, "that of the profile minecraft", "your domain's own"),
    toml("[reddit]", "page_seconds = 8\n[reddit]", 8, "'wiki.page_seconds'", "settle_seconds"),
    toml("[release]", 'include = ["water"]\n[release]', 12, 'everyday word "water"', "near"),
    row("Water\tthing\n", "'Water' is an everyday word and has no rule", "near"),
    row("Scree\tplace\t\tstone\n", "'stone' is an everyday word", "never"),
    row("saxifrage\tplace\n", "'saxifrage' stands on line 2", "the first counts"),
    row("Scree\tplace\t\t!!\n", "the form '!!' has no word"),
    row("A1\tplant\nA2\tplant\nScree\tplnt\n", "the kind 'plnt' stands only here", "'plant'"),
]  # fmt: skip


def written(place: Path, broken: Broken | None = None) -> Path:
    """The good profile in `place`, with one thing broken."""
    texts = {"profile.toml": GOOD, "keywords.tsv": LIST}
    if broken is not None:
        assert broken.old in texts[broken.file]
        texts[broken.file] = texts[broken.file].replace(broken.old, broken.new, 1)
    for name, text in texts.items():
        (place / name).write_text(text, encoding="utf-8")
    return place / "profile.toml"


@pytest.fixture(scope="module")
def sandbox() -> Iterator[Sandbox]:
    with Sandbox(small_world(24, width=120, depth=24)) as services:
        yield services


Typed = Callable[..., int]


@pytest.fixture
def typed(tmp_path: Path, sandbox: Sandbox, monkeypatch: pytest.MonkeyPatch) -> Typed:
    """typed("profile", "check") → exit code, in this process, in an empty folder beside
    services.
    """
    monkeypatch.chdir(tmp_path)
    for name in set(os.environ) - set(clean_environment()):
        monkeypatch.delenv(name)
    for name, value in sandbox.settings().items():
        monkeypatch.setenv(name, value)

    def run(*words: str) -> int:
        with pytest.raises(SystemExit) as ended:
            main(list(words))
        return int(ended.value.code or 0)

    return run


def summary_of(capsys: pytest.CaptureFixture[str]) -> dict[str, Any]:
    return json.loads(capsys.readouterr().out.splitlines()[-1])


def place_of(finding: dict[str, Any]) -> str:
    return f"{finding['file']}:{finding['line']}" if finding["line"] else finding["file"]


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
    assert "KB_CONTACT is the placeholder you@example.com" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("spdx", "mend"),
    [("CC-BY-4", 'did you mean "CC-BY-4.0"?'), ("MY-LICENCE", "known: CC-BY-4.0, ")],
)
def test_a_licence_is_one_that_a_release_can_carry(
    spdx: str, mend: str, tmp_path: Path, typed: Typed, capsys: pytest.CaptureFixture[str]
) -> None:
    path = written(tmp_path)
    path.write_text(f'{GOOD}licenses = {{ youtube = "{spdx}" }}\n')
    assert typed("profile", "check", str(path), "--json") == 2
    (one,) = summary_of(capsys)["findings"]
    assert one["key"] == "release.licenses.youtube"
    assert spdx in one["what"]
    assert mend in one["mend"]
    assert typed("links", "--profile", str(path), "--data", str(tmp_path)) == 1  # nothing is there


def test_an_everyday_word_that_is_meant_is_no_warning(
    typed: Typed, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    written(tmp_path, row("Water\tthing\talways\tstone\n", "", ""))
    assert typed("profile", "check", "./profile.toml", "--json") == 0
    assert "everyday" not in capsys.readouterr().out


def test_there_are_thirty() -> None:
    assert len(ERRORS) >= 30


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
    assert broken.mend in one["mend"]
    assert summary["errors"] == 1
    for command in (("youtube", "crawl"), ("wiki", "filter"), ("pairs",)):
        assert typed(*command, "--profile", str(path)) == 2
        line = capsys.readouterr().err
        assert line.count("\n") == 1
        assert "kb profile check" in line
    assert len(sandbox.ledger.requests()) == asked
    assert not (tmp_path / "data").exists()


@pytest.mark.parametrize("broken", WARNINGS, ids=lambda one: one.new[:40])
def test_what_can_hardly_be_meant_is_a_warning(
    broken: Broken, tmp_path: Path, typed: Typed, capsys: pytest.CaptureFixture[str]
) -> None:
    path = written(tmp_path, broken)
    assert typed("profile", "check", str(path), "--json") == 0
    summary = summary_of(capsys)
    found = [one for one in summary["findings"] if one["level"] == "warning"]
    (one,) = [one for one in found if broken.said in one["what"]]
    assert broken.mend in one["mend"]
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


def test_a_copied_folder_beside_the_shipped_ones_needs_its_own_name(
    tmp_path: Path, typed: Typed, capsys: pytest.CaptureFixture[str], monkeypatch: Any
) -> None:
    from kb.core import profile, resources
    from kb.core.profile import sense

    profiles = tmp_path / "profiles"
    (profiles / "garden").mkdir(parents=True)
    written(profiles / "garden", toml('"garden"', '"minecraft"', 1, ""))
    for module in (profile, sense, resources):
        monkeypatch.setattr(module, "folder", lambda name: profiles)
    assert typed("profile", "check", "garden", "--json") == 2
    (one,) = [found for found in summary_of(capsys)["findings"] if found["level"] == "error"]
    assert "the profile's folder is garden" in one["what"]
    assert 'name = "garden"' in one["mend"]


# -- over a data root ------------------------------------------------------------------------------


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


# -- online ----------------------------------------------------------------------------------------


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
    assert "no subreddit of that name" in found["online: reddit"]["mend"]


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
