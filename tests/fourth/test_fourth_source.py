"""A fourth source is one folder, its schemas and one name among the sources.

The test adds them to a copy of the project and takes the source through every command.
"""

import json
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pyarrow.dataset as ds
import pytest

from tests.cli.conftest import clean_environment
from tests.fourth.service import Service, serving

ROOT, HERE = Path(__file__).resolve().parents[2], Path(__file__).resolve().parent
PROFILE = """
name = "notes"
title = "Notes"
[feed]
url = "{url}"
min_likes = 3
[pairs]
include = ["n007", "text"]
[release]
contact = "me@notes.org.uk"
creators = [{{ name = "Someone" }}]
"""


@pytest.fixture(scope="module")
def project(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A copy of the project with the fourth source."""
    place = tmp_path_factory.mktemp("project")
    for name in ("kb", "schemas", "pipelines", "data/profiles"):
        shutil.copytree(ROOT / name, place / name)
    shutil.copytree(HERE / "feed", place / "kb/feed")
    shutil.copytree(HERE / "schemas", place / "schemas", dirs_exist_ok=True)
    sources = place / "kb/core/sources.py"
    text = f"from kb.feed.source import Feed\n{sources.read_text()}"
    sources.write_text(text.replace("YouTube, Wiki, Reddit)", "YouTube, Wiki, Reddit, Feed)"))
    return place


@pytest.fixture(scope="module")
def service() -> Iterator[Service]:
    """Ten notes on four pages."""
    with serving(10) as running:
        yield running


Kb = Callable[..., dict[str, Any]]


@pytest.fixture(scope="module")
def kb(project: Path, service: Service) -> Kb:
    """Run a command of the copy on its data root; the summary."""
    profile = project / "notes.toml"
    profile.write_text(PROFILE.format(url=service.root))

    def run(*words: str) -> dict[str, Any]:
        command = [sys.executable, "-m", "kb", *words, "--data", "data/root", "--json"]
        done = subprocess.run(
            [*command, "--profile", str(profile)],
            cwd=project,
            env={**clean_environment(), "PYTHONPATH": str(project)},
            capture_output=True,
            text=True,
            check=False,
        )
        assert done.returncode == 0, done.stdout + done.stderr
        summary: dict[str, Any] = json.loads(done.stdout.splitlines()[-1])
        return summary

    return run


def released(project: Path) -> list[str]:
    """The notes that are published."""
    folder = project / "data/root/release/feed"
    rows = ds.dataset(sorted(folder.glob("notes-*.parquet"))).to_table()
    assert rows.column_names == ["note_id", "likes", "fetched_at"]
    return [str(key) for key in rows["note_id"].to_pylist()]


def test_from_crawl_to_purge(project: Path, kb: Kb) -> None:
    """crawl → filter → export → links → search → report → release → status → purge."""
    lines = sum(
        len(path.read_text().splitlines())
        for folder in (HERE / "feed", HERE / "schemas")
        for path in folder.rglob("*.*")
        if path.suffix in (".py", ".toml", ".json")
    )
    assert lines < 250
    assert kb("feed", "crawl")["crawled"] == 10
    sorted_rows = kb("feed", "filter")
    assert (sorted_rows["kept"], sorted_rows["rejected"]) == (7, 3)
    assert kb("feed", "export")["notes"] == 7
    kept = [f"n{number:03d}" for number in range(3, 10)]
    assert released(project) == kept
    assert kb("links")["sources"] == {"feed": 8}
    (answer,) = kb("search", "n007")["answers"]
    assert (answer["source"], answer["key"]) == ("feed", "n007")
    assert kb("release")["folders"] == 2  # the feed and links
    assert (
        "Notes of a feed about Notes." in (project / "data/root/release/feed/README.md").read_text()
    )
    status = kb("status")
    assert (status["sources"]["feed"]["crawled_so_far"], status["left"]) == (10, 0)
    (project / "gone.txt").write_text("n007\n")
    planned = kb("purge", "feed", "--ids", "gone.txt", "--plan")
    for summary in (planned, kb("purge", "feed", "--ids", "gone.txt")):
        assert [summary[name] for name in ("purged", "known", "unknown", "unread")] == [1, 0, 0, 0]
    again = kb("purge", "feed", "--ids", "gone.txt")
    assert [again[name] for name in ("purged", "known", "unknown", "unread")] == [0, 1, 0, 0]
    assert released(project) == [key for key in kept if key != "n007"]
    assert kb("search", "n007")["answers"] == []
    assert kb("verify")["files_damaged"] == 0
