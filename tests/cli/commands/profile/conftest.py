"""A good profile, the ways to break it, and a sandbox to check it against."""

import json
import os
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

import pytest

from kb.cli import main
from tests.cli.conftest import clean_environment
from tests.faults import Sandbox
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
licenses.youtube = "CC-BY-4.0"
licenses.reddit = "CC-BY-4.0"
licenses.pairs = "CC-BY-4.0"
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
    fix: str


def toml(old: str, new: str, line: int, said: str, fix: str = "") -> Broken:
    return Broken("profile.toml", old, new, f"profile.toml:{line}", said, fix)


def row(text: str, said: str, fix: str = "") -> Broken:
    """A row more at the end of the list."""
    return Broken("keywords.tsv", LIST, LIST + text, "keywords.tsv:5", said, fix)


def file(text: str, where: str, said: str, fix: str = "") -> Broken:
    return Broken("keywords.tsv", LIST, text, where, said, fix)


CONTACT = 'contact = "me@gardens.wiki"'


ERRORS = [
    toml('title = "Rock Gardens"', "title = Rock Gardens", 2, "not valid TOML", "toml.io"),
    toml('title = "Rock Gardens"', 'title = "Rock', 2, "not valid TOML: "),
    toml("[wiki]", "keywords = []\n[wiki]", 6, "not valid TOML: Cannot overwrite"),
    toml("[wiki]", "[youtube]\n[wiki]", 6, "not valid TOML: Cannot declare"),
    toml("[26]", "[26]\nmin_vews = 5", 6, "unknown key 'youtube.min_vews'", "'min_views'"),
    toml("[wiki]", "[wikis]", 6, "unknown key 'wikis'", "did you mean 'wiki'?"),
    toml('title = "Rock Gardens"\n', "", 0, "'title' is missing", "add a line title ="),
    toml('url = "https://gardens.wiki"\n', "", 6, "'wiki.url' is missing", "add a line wiki.url"),
    toml('["rock garden"]', '"rock garden"', 4, "'youtube.keywords' is", "valid tuple"),
    toml("[26]", "[26]\nmin_views = -1", 6, "'youtube.min_views' is -1", "or equal to 0"),
    toml("[26]", '["Howto"]', 5, "'youtube.category_ids[1]' is", "valid integer"),
    toml("[26]", '["FILL-IN"]', 5, "'youtube.category_ids' is still to be filled in"),
    toml('["rock garden"]', '["FILL-IN"]', 4, "'youtube.keywords' is still to be filled in"),
    toml('"rockgarden"', '"r/rockgarden"', 9, '"r/rockgarden"', "name without r/"),
    toml('"rockgarden"', '"https://reddit.com/r/alpines/"', 9, "/alpines", "name without r/"),
    toml('"https://gardens.wiki"', '"gardens.wiki"', 7, "'wiki.url' is", "an address like"),
    toml('"https://gardens.wiki"', '"https://gardens"', 7, "host is not a full name", "an address"),
    toml("//gardens.wiki", "//gardens.wiki/api.php", 7, "not the wiki's root", '//gardens.wiki"'),
    toml("[reddit]", 'hosts = ["https://a.b/c"]\n[reddit]', 8, "not a host name", "write a name"),
    toml("[26]", "[26]\nmin_duration_s = 1e6", 6, "is 1000000.0", "43200"),
    toml("[26]", "[26]\nmin_aspect_ratio = 16", 6, "is 16", "or equal to 10"),
    toml("[reddit]", '[wiki.markup]\nslot = ".a["\n[reddit]', 9, ".a[", "must be a CSS selector"),
    toml("[reddit]", '[wiki.markup]\nroot = "#a >"\n[reddit]', 9, "#a >", "before its last part"),
    toml('"rockgarden"', '"rockgarden"\nmin_score = 2_000_000', 10, "is 2000000", "1000000"),
    toml('"rockgarden"', '"rockgarden"\nspans = ["weekly"]', 10, "'reddit.spans[1]'", "'week'"),
    toml("[release]", "min_clip_s = 20\n[release]", 10, "min_clip_s is above max_clip_s"),
    toml("[release]", "min_tokens = 70\nmax_tokens = 60\n[release]", 10, "min_tokens is above"),
    toml("[release]", "[toxicity.thresholds]\nreddit = 0\n[release]", 13, "is 0", "than 0"),
    toml("[reddit]", "max_page_height = 1000\n[reddit]", 8, "nothing passes", "the window"),
    toml(CONTACT, 'contact = "me"', 13, "not an e-mail or web address", "such as"),
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
    row("Trough\tplace\tneer\n", "the rule is 'neer'", "one of topic, near, never, always"),
    row("Trough\tplace\tnear:\n", "the rule is 'near:'", "such as near:30"),
    row("Trough\tplace\tnear:0\n", "the rule is 'near:0'", "a number of words"),
    row("?!\tplace\n", "the keyword '?!' has no word"),
    row(f"{'very ' * 20}long\tplace\n", "has more than 64 letters"),
    row("FILL-IN\tplace\n", "the line is still to be filled in"),
    file("Saxifrage\tplant\n", "keywords.tsv:1", "the first line must read keyword, kind"),
    file("keyword,kind,rule,forms\nA,b\n", "keywords.tsv:1", "the first line", "put tabs"),
    file(HEADER, "keywords.tsv", "the list contains no keyword"),
    file(HEADER + "Spring\tseason\tnear\n", "keywords.tsv:2", "every keyword has a rule"),
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


Typed = Callable[..., int]


@pytest.fixture(scope="module")
def sandbox() -> Iterator[Sandbox]:
    with Sandbox(small_world(24, width=120, depth=24)) as services:
        yield services


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
