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


Kb = Callable[..., list[dict[str, Any]]]
# Importing kb takes most of the time of a command: one process runs several.
COMMANDS = """
import json, sys
from kb.cli import main
for words in json.loads(sys.argv[1]):
    try:
        main([*words, *sys.argv[2:]])
    except SystemExit as ended:
        if ended.code:
            raise
"""


@pytest.fixture(scope="module")
def kb(project: Path, service: Service) -> Kb:
    """Run commands of the copy on its data root; their summaries."""
    profile = project / "notes.toml"
    profile.write_text(PROFILE.format(url=service.root))
    options = ["--data", "data/root", "--json", "--profile", str(profile)]

    def run(*commands: str) -> list[dict[str, Any]]:
        words = json.dumps([command.split() for command in commands])
        done = subprocess.run(
            [sys.executable, "-c", COMMANDS, words, *options],
            cwd=project,
            env={**clean_environment(), "PYTHONPATH": str(project)},
            capture_output=True,
            text=True,
            check=False,
        )
        assert done.returncode == 0, done.stdout + done.stderr
        return [json.loads(line) for line in done.stdout.splitlines() if line.startswith("{")]

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
    crawled, filtered, exported, linked, found, made, status = kb(
        "feed crawl", "feed filter", "feed export", "links", "search n007", "release", "status"
    )
    assert crawled["crawled"] == 10
    assert (filtered["kept"], filtered["rejected"]) == (7, 3)
    assert exported["notes"] == 7
    kept = [f"n{number:03d}" for number in range(3, 10)]
    assert released(project) == kept
    assert linked["sources"] == {"feed": 8}
    (answer,) = found["answers"]
    assert (answer["source"], answer["key"]) == ("feed", "n007")
    assert made["folders"] == 2  # the feed and links
    assert (
        "Notes of a feed about Notes." in (project / "data/root/release/feed/README.md").read_text()
    )
    assert (status["sources"]["feed"]["crawled_so_far"], status["left"]) == (10, 0)
    (project / "gone.txt").write_text("n007\n")
    purge = "purge feed --ids gone.txt"
    planned, purged, again, found, verified = kb(
        f"{purge} --plan", purge, purge, "search n007", "verify"
    )
    for summary, numbers in (
        (planned, [1, 0, 0, 0]),
        (purged, [1, 0, 0, 0]),
        (again, [0, 1, 0, 0]),
    ):
        assert [summary[name] for name in ("purged", "known", "unknown", "unread")] == numbers
    assert released(project) == [key for key in kept if key != "n007"]
    assert found["answers"] == []
    assert verified["files_damaged"] == 0
