"""What is searched is said in the same words by command, page, agent and document."""

from pathlib import Path

import pytest

from kb.core.config.profile import load_profile
from kb.core.config.settings import load_settings
from kb.core.context import Run
from kb.explore import search as search_page
from kb.mcp.search_tool import run_search
from kb.mcp.server import run_about
from kb.search.coverage import coverage
from kb.search.ranking import Only
from tests import inprocess
from tests.cli.conftest import clean_environment
from tests.conftest import ROOT

OF_A_RELEASE = (
    "Search covers titles of videos and the wiki's pages; no transcripts, no posts, no comments:"
    " `kb restore` brings them back."
)


@pytest.fixture
def release(
    downloads: Path, tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch
) -> Path:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path_factory.getbasetemp() / "cache"))
    return downloads / "release"


@pytest.mark.parametrize("words", ["wolf", "nothinghasthis"])
def test_everyone_who_searches_a_release_is_told(release: Path, tmp_path: Path, words: str) -> None:
    env = clean_environment()
    done = inprocess.run(["search", words, "--data", release], env=env, cwd=tmp_path)
    assert OF_A_RELEASE in done.err.splitlines()
    run = Run(load_settings(dotenv=False), load_profile("minecraft"), release)
    assert OF_A_RELEASE in run_search(run, words, [], Only(), 4_000)
    assert OF_A_RELEASE in run_about(run, 8_000)
    assert search_page.read(release, run.profile, {"words": words}).covers == OF_A_RELEASE
    assert OF_A_RELEASE in (ROOT / "docs" / "using-a-release.md").read_text(encoding="utf-8")


def test_of_a_part_and_of_a_whole(downloads: Path, demo: Path) -> None:
    release = downloads / "release"
    assert str(coverage(release / "wiki")) == "Search covers the wiki's pages."
    assert str(coverage(release / "youtube")) == (
        "Search covers titles of videos; no transcripts: `kb restore` brings them back."
    )
    assert str(coverage(release / "reddit")) == (
        "Search covers nothing; no posts, no comments: `kb restore` brings them back."
    )
    assert str(coverage(demo / "data" / "demo")) == (
        "Search covers titles of videos, transcripts, the wiki's pages, posts and comments."
    )
    assert str(coverage(downloads / "release-restored")) == (
        "Search covers titles of videos, transcripts, posts and comments."
    )
