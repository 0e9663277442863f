"""Exit code 2 comes before anything is written: a command that lacks a credential, a model or an
optional package leaves a data root as it was, which remembers no profile either.
"""

import json
import shutil
import sys
from pathlib import Path

import pytest

from kb.store.rawlog import rawlog
from tests.faults import Sandbox
from tests.inprocess import Here
from tests.reddit.conftest import small_world
from tests.reddit.work import NOW, Work

CONTACT = {"KB_CONTACT": "me@example.org"}
NO_MODEL = {"KB_TOXICITY_MODEL": "no/such/checkpoint.ckpt"}


@pytest.fixture(scope="module")
def stored(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Raw answers, clean tables and a release, as someone would copy them: without state/."""
    with (
        pytest.MonkeyPatch.context() as patch,
        Sandbox(small_world(6, width=5, depth=3), services=["reddit"]) as sandbox,
    ):
        patch.setenv("KB_NOW", NOW)
        work = Work(sandbox, tmp_path_factory.mktemp("stored"))
        work.crawl()
        work.filter()
        work.export()
    shutil.rmtree(work.root / "state")
    for source, kind in (("youtube", "videos"), ("wiki", "pages")):
        segment = rawlog.folder(work.root, source, kind) / "000001.ndjson.zst"
        segment.parent.mkdir(parents=True)
        segment.write_bytes(rawlog.compressor().compress(b"{}\n"))
    return work.root


@pytest.mark.parametrize(
    ("words", "env", "missing"),
    [
        ("reddit crawl", CONTACT, "REDDIT_CLIENT_ID"),
        ("refresh reddit", CONTACT, "REDDIT_CLIENT_ID"),
        ("reddit reconstruct", CONTACT, "REDDIT_CLIENT_ID"),
        ("reddit reconstruct --out {place}/out", CONTACT, "REDDIT_CLIENT_ID"),
        ("restore {root}/release/reddit", CONTACT, "REDDIT_CLIENT_ID"),
        ("youtube crawl", {}, "YOUTUBE_API_KEY"),
        ("refresh youtube", {}, "YOUTUBE_API_KEY"),
        ("wiki crawl", {}, "KB_CONTACT"),
        ("release publish --to zenodo", {}, "ZENODO_TOKEN"),
        ("release publish --to huggingface", {}, "HF_TOKEN"),
        ("release publish --to huggingface", {"HF_TOKEN": "hf_any"}, "huggingface-hub"),
        ("annotate reddit", NO_MODEL, "no/such/checkpoint.ckpt"),
        ("reddit filter", NO_MODEL, "no/such/checkpoint.ckpt"),
        ("pairs", {}, "tokenizers"),
        ("report", {}, "matplotlib"),
    ],
    ids=str,
)
def test_what_is_missing_is_named_and_nothing_is_written(
    stored: Path,
    here: Here,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    words: str,
    env: dict[str, str],
    missing: str,
) -> None:
    if missing.islower() and "/" not in missing:  # an optional package
        monkeypatch.setitem(sys.modules, missing.replace("-", "_"), None)
    before = listing(stored)
    named = words.format(root=stored, place=tmp_path).split()
    done = here(*named, "--data", str(stored), env=env)
    assert done.code == 2, done
    assert missing in done.said
    assert listing(stored) == before
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("words", "way"),
    [
        ("reddit crawl", "kb reddit import FILE"),
        ("reddit reconstruct", "--dumps FILE"),
        ("restore {root}/release/reddit", "--dumps FILE"),
    ],
)
def test_without_a_key_of_reddit_the_way_through_dumps_is_named_first(
    stored: Path, here: Here, words: str, way: str
) -> None:
    done = here(*words.format(root=stored).split(), "--data", str(stored), env=CONTACT)
    said = done.err
    assert said.index(way) < said.index(".env.example") < said.index("Responsible Builder Policy")


def test_status_advises_nothing_that_needs_a_key_of_reddit_where_there_is_none(
    stored: Path, here: Here, tmp_path: Path
) -> None:
    later = {"KB_NOW": "2027-06-01T00:00:00Z"}  # what was read is too old by then
    key = {"REDDIT_CLIENT_ID": "an-id", "REDDIT_CLIENT_SECRET": "a-secret"}
    root = shutil.copytree(stored, tmp_path / "copy")  # whose missing state it replays
    steps = {}
    for name, env in (("none", later), ("key", {**later, **key})):
        steps[name] = json.loads(here("status", "--json", "--data", str(root), env=env).out)["next"]
    assert any("refresh reddit" in step for step in steps["key"])
    assert not any("refresh reddit" in step for step in steps["none"])


def test_a_root_remembers_the_profile_of_the_first_command_that_writes(
    stored: Path, here: Here, tmp_path: Path
) -> None:
    root = Path(shutil.copytree(stored, tmp_path / "copy"))
    memory = root / "state" / "profile.json"
    assert here("reddit", "reconstruct", "--plan", "--data", str(root)).code == 0
    assert here("query", "FROM reddit_posts", "--data", str(root)).code == 0
    assert not memory.exists(), "neither of them writes"
    assert here("reddit", "export", "--data", str(root)).code == 0
    assert memory.exists()


def listing(root: Path) -> dict[str, int]:
    """Every file and folder with the time of its last change."""
    return {str(path.relative_to(root)): path.stat().st_mtime_ns for path in root.rglob("*")}
