"""`kb status` reads the state of all sources, also beside a running crawl."""

from pathlib import Path
from typing import Any

from tests.cli.commands.status.conftest import fill


def test_an_empty_root_says_where_to_start_and_writes_nothing(kb: Any, tmp_path: Path) -> None:
    answer = kb("status")
    assert answer.returncode == 0
    assert "nothing collected yet" in answer.stdout
    assert "kb demo" in answer.stdout
    assert list(tmp_path.iterdir()) == []


def test_for_people(kb: Any, root: Path) -> None:
    fill(root)
    now = {"KB_NOW": "2026-11-20T20:00:00Z"}
    answer = kb("status", env=now | {"YOUTUBE_API_KEY": "one"})
    assert "metadata" in answer.stdout
    assert "quota spent today: general 2 of 10,000, search 0 of 100," in answer.stdout
    assert "resets 2026-11-21T08:00:00Z" in answer.stdout
    assert "1 rows older than 30 days" in answer.stdout
    assert "next: kb youtube crawl\n" in answer.stdout
    without = kb("status", env=now).stdout
    assert "quota" not in without
    assert "kb youtube crawl" not in without


def test_damaged_state_is_one_line(kb: Any, root: Path) -> None:
    (root / "state").mkdir(parents=True)
    (root / "state" / "reddit.sqlite").write_bytes(
        b"this is no database, whatever its name says" * 100
    )
    answer = kb("status")
    assert answer.returncode == 1
    assert "reddit.sqlite" in answer.stderr
    assert answer.stderr.count("\n") == 1
