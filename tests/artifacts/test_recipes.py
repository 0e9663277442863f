"""A user's own recipe: it is an input of what it makes, and runs only where the user named it."""

import json
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest

from kb.artifacts import manifest
from kb.store.atomic import write_bytes
from tests.filters.made import MONDAY, listing, put, transcript, video
from tests.inprocess import Done, Here
from tests.release.signed import LINES

PROFILE = f"""
name = "blocks"
title = "Blocks"
[youtube]
pipeline = "recipes/mine.py"
keywords = ["Minecraft"]
category_ids = [20]
[toxicity]
toxicity = "off"
[release]
{LINES}"""
RECIPE = '''"""Keeps what the shipped recipe keeps."""
from pathlib import Path
from kb.core.config.pipeline import Recipe

Path({mark!r}).touch()
LIMIT = 1


def clean(p):
    return Recipe("youtube").defined("clean")(p)
'''
Kb = Callable[..., Done]


@pytest.fixture
def mark(tmp_path: Path) -> Path:
    """A file that the recipe makes when it runs."""
    return tmp_path / "ran"


@pytest.fixture
def profile(tmp_path: Path, mark: Path) -> Path:
    place = tmp_path / "domain" / "profile.toml"
    write_bytes(place, PROFILE.encode())
    write_bytes(place.parent / "recipes" / "mine.py", RECIPE.format(mark=str(mark)).encode())
    return place


@pytest.fixture
def root(tmp_path: Path) -> Path:
    put(tmp_path / "data", "videos", (MONDAY, {}, listing(video("kept0000001"))))
    put(tmp_path / "data", "transcripts", transcript("kept0000001"))
    return tmp_path / "data"


@pytest.fixture
def kb(here: Here, root: Path, tmp_path: Path) -> Kb:
    """Commands on the root, as one user of one machine."""

    def typed(*words: object, data: Path = root, home: str = "home") -> Done:
        env = {"XDG_STATE_HOME": str(tmp_path / home), "KB_NOW": "2026-11-18T12:00:00Z"}
        return here(*map(str, words), "--data", str(data), env=env)

    return typed


def reasons(done: Done) -> dict[str, list[str]]:
    steps = json.loads(done.out.splitlines()[-1])["steps"]
    return {step["artifact"]: step["reasons"] for step in steps}


def test_a_recipe_is_an_input(kb: Kb, profile: Path, root: Path, mark: Path) -> None:
    named = ("--profile", profile)
    assert kb("build", *named).code == 0
    assert mark.exists()
    assert kb("build", "--plan").out == "build --plan: 0 to make, 7 up to date\n"
    recipe = profile.parent / "recipes" / "mine.py"
    recipe.write_text(recipe.read_text().replace("Keeps", "Takes") + "# a remark\n")
    assert reasons(kb("build", "--plan", "--json", *named)) == {}  # it does the same
    recipe.write_text(recipe.read_text().replace("LIMIT = 1", "LIMIT = 2"))
    changed = reasons(kb("build", "--plan", "--json", *named))
    assert changed["clean/youtube"] == ["recipes/mine.py changed"]
    assert "recipes/mine.py changed" in kb("status", *named).out
    refused = kb("release", *named)
    assert (refused.code, "recipes/mine.py changed" in refused.err) == (1, True)
    assert kb("build", *named).code == 0
    profile.write_text(profile.read_text().replace("pipeline =", "# pipeline ="))
    dropped = reasons(kb("build", "--plan", "--json", *named))
    assert dropped["clean/youtube"] == ["recipes/mine.py is not its recipe"]


@pytest.mark.parametrize(
    ("text", "code", "message"),
    [
        ("{}['x']", 2, "mine.py can't be loaded: KeyError: 'x'"),
        ("raise SystemExit(3)", 2, "mine.py can't be loaded: SystemExit: 3"),
        ("def clean(p):\n    return {}['x']", 1, "mine.py, line 2: KeyError: 'x'"),
        ("def clean(p):\n    raise SystemExit(3)", 1, "mine.py, line 2: SystemExit: 3"),
        (
            (
                "from dataclasses import replace\n"
                "from kb.core.config.pipeline import Recipe\n"
                "def clean(p):\n"
                "    return replace(Recipe('youtube').defined('clean')(p), complete=count)\n"
                "def count(tables):\n"
                "    return {}['x']\n"
            ),
            1,
            "mine.py, line 6: KeyError: 'x'",
        ),
    ],
)
def test_what_fails_in_a_recipe_is_its_line(
    kb: Kb, profile: Path, text: str, code: int, message: str
) -> None:
    (profile.parent / "recipes" / "mine.py").write_text(text)
    done = kb("youtube", "filter", "--workers", "2", "--profile", profile)
    assert (done.code, message in done.said) == (code, True), done.err


def test_what_ran_here_runs_again_until_it_is_another(
    kb: Kb, profile: Path, root: Path, mark: Path
) -> None:
    assert kb("youtube", "filter", "--profile", profile).code == 0
    kept = root / "state" / "profile" / "recipes" / "mine.py"
    assert kept.read_bytes() == (profile.parent / "recipes" / "mine.py").read_bytes()
    assert kb("youtube", "filter").code == 0
    mark.unlink()
    assert kb("youtube", "filter", home="elsewhere").code == 2
    shutil.rmtree(profile.parent)
    assert kb("youtube", "filter").code == 0  # the root's own copy
    mark.unlink()
    kept.write_text(kept.read_text() + "import os\n")
    done = kb("youtube", "filter")
    assert (done.code, str(kept) in done.err, mark.exists()) == (2, True, False)


@pytest.mark.parametrize("named_by", ["the copy", "a path in the root", "a link"])
def test_a_strangers_root_runs_nothing(
    kb: Kb, profile: Path, root: Path, mark: Path, tmp_path: Path, named_by: str
) -> None:
    assert kb("build", "--profile", profile).code == 0
    theirs = shutil.copytree(root, tmp_path / "theirs")
    recipe = theirs / "state" / "profile" / "recipes" / "mine.py"
    if named_by == "a path in the root":
        at = shutil.copytree(profile.parent, theirs / "raw" / "domain")
        binding = {"name": "blocks", "file": "/none", "from_root": "raw/x/../domain/profile.toml"}
        (theirs / "state" / "profile.json").write_text(json.dumps(binding))
        recipe = at / "recipes" / "mine.py"
    shutil.rmtree(profile.parent)
    if named_by == "a link":
        shutil.move(recipe, theirs / "raw" / "mine.py")
        recipe.symlink_to("../../../raw/mine.py")
    mark.unlink()
    put(theirs, "videos", (MONDAY, {}, listing(video("more0000001"))))

    def paths() -> list[Path]:  # each of our runs leaves its record
        return sorted(path for path in theirs.rglob("*") if path.parent.name != "runs")

    before = paths()
    for command in ("build", "youtube filter", "youtube crawl", "release"):
        done = kb(*command.split(), data=theirs)
        assert done.code == (1 if command == "release" else 2), done.err
        assert command == "release" or str(recipe) in done.err
    planned = kb("build", "--plan", "--json", data=theirs)
    assert str(recipe) in planned.out
    assert kb("status", data=theirs).code == kb("build", "--graph", data=theirs).code == 0
    assert not mark.exists()
    assert paths() == before


def test_a_release_has_its_recipe_as_text_that_nothing_runs(
    kb: Kb, profile: Path, root: Path, mark: Path
) -> None:
    assert kb("build", "--profile", profile).code == 0
    folder, recipe = root / "release" / "youtube", profile.parent / "recipes" / "mine.py"
    assert (folder / "recipe-youtube.txt").read_bytes() == recipe.read_bytes()
    assert "recipe-youtube.txt" in (folder / "SHA256SUMS").read_text()
    assert list(json.loads((folder / "provenance.json").read_text())["recipes"]) == [
        "recipe-youtube.txt"
    ]
    mark.unlink()
    shutil.copytree(recipe.parent, folder / "recipes")  # as a stranger might
    link = profile.with_name("link.toml")
    link.symlink_to(folder / "profile.toml")
    for named in (f"{folder}/", folder / "profile.toml", link):
        done = kb("youtube", "filter", "--profile", named, home="elsewhere")
        beside = folder if named != link else link.parent  # files of a link's profile lie beside it
        assert (done.code, str(beside / "recipes" / "mine.py") in done.err) == (2, True), done.err
    assert not mark.exists()


@pytest.mark.parametrize("name", ["../mine.py", "/tmp/mine.py", "mine.toml"])
def test_a_recipe_lies_beside_its_profile(kb: Kb, profile: Path, name: str) -> None:
    profile.write_text(profile.read_text().replace("recipes/mine.py", name))
    done = kb("build", "--profile", profile)
    assert (done.code, "youtube.pipeline" in done.err) == (2, True)


def test_an_export_is_made_again_with_its_options(kb: Kb, profile: Path, root: Path) -> None:
    named = ("--profile", profile)
    assert kb("build", *named).code == 0
    export = ("youtube", "export", "--format", "text")
    assert kb(*export, "--keep-contacts", *named).code == 0
    put(root, "videos", (MONDAY, {}, listing(video("more0000001"))))
    put(root, "transcripts", transcript("more0000001"))
    assert kb("build", "text", *named).code == 0
    made = manifest.read_manifest(root, "export/text/youtube.jsonl")
    assert made is not None
    assert made.figures == {"keep_contacts": True}
    assert len((root / "export/text/youtube.jsonl").read_text().splitlines()) == 2


def test_a_plan_begins_with_what_stands_in_its_way(kb: Kb, root: Path, tmp_path: Path) -> None:
    profile = tmp_path / "profile.toml"
    profile.write_text(PROFILE.replace('toxicity = "off"', "").replace("pipeline", "# "))
    done = kb("build", "--plan", "--profile", profile)
    lines = done.out.splitlines()
    assert lines[0].startswith("clean/youtube can't be made: ")
    assert "kb models fetch" in lines[0]
    assert lines[-1] == "build --plan: 0 to make, 7 that can't be made yet, 0 up to date"
    built = kb("build", "--profile", profile)
    assert built.code == 1
    assert sum("kb models fetch" in line for line in built.err.splitlines()) == 2  # and in the end
    assert "left out, as what they are made of failed: release/youtube, tasks," in built.err


def test_the_graph_is_printed_and_drawn(kb: Kb, profile: Path, tmp_path: Path) -> None:
    assert kb("build", "--profile", profile).code == 0
    drawing = tmp_path / "graph.svg"
    done = kb("build", "--graph", "--out", drawing)
    made = "clean/youtube  current\n    from raw/youtube by pipelines/youtube.py, recipes/mine.py,"
    assert made in done.out
    assert "pairs  not made: there is nothing to make it from\n" in done.out
    assert "<!-- clean/youtube -->" in drawing.read_text()
    assert kb("build", "--out", drawing).code == 2
    assert kb("build", "pairs", "--graph", "--out", drawing).code == 0
