"""The log of `--log`: what it holds, what never stands in it, and what becomes of a full disk."""

import logging
from pathlib import Path

import pytest

from kb.core import run_log
from kb.core.engine import make_executor
from kb.core.progress import EVENTS, Progress
from kb.core.run_log import logging_to, private


def never(text: str) -> None:
    raise AssertionError(text)


@pytest.mark.parametrize(
    "named",
    [
        "dQw4w9WgXcQ",
        "-_aB3dE6gH9",
        "UCabcdefghij0123456789_-",
        "t3_1abcde",
        "t1_k0ffee",
        "u/KilnRoad",
        "/user/Kiln-Road",
    ],
)
def test_what_a_purge_removes_stands_in_no_line(named: str) -> None:
    for text in (f"{named} failed", f"3 tries ({named}): gone", f"unread: {named!r}", f"[{named}]"):
        assert named.rpartition("/")[2] not in private(text)
    address = f"https://www.youtube.com/watch?v={named}"
    assert private(f"GET {address}: 404") == "GET https://www.youtube.com/…: 404"


@pytest.mark.parametrize(
    "text",
    [
        "out of date: youtube.min_views 100 → 500, made on 2026-11-28T08:47:22Z",
        "'youtube.min_views' is 100: information about settings",
        "release/youtube: transcripts 12345678901 characters"[:48],
        "no space left to write /data/root/raw/youtube: it has 3.1 MB free",
    ],
)
def test_words_of_the_program_stay(text: str) -> None:
    assert private(text) == text


def test_secrets_are_cleaned_and_a_line_stays_one(tmp_path: Path) -> None:
    path = tmp_path / "deep" / "kb.log"
    with logging_to(path, "build", lambda text: text.replace("s3cr3t", "***"), never):
        Progress().say("with s3cr3t\nand \x1b[31m")
        logging.getLogger("praw").warning("half of %s", "s3cr3t")
    first, second = path.read_text(encoding="utf-8").splitlines()
    assert first.endswith("with ***\\nand \\x1b[31m")
    assert " info build[" in first
    assert second.endswith("] praw: half of ***")
    EVENTS.info("after")
    assert "after" not in path.read_text(encoding="utf-8")


def test_a_long_log_is_rotated_and_five_are_kept(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(run_log, "BYTES", 300)
    path = tmp_path / "kb.log"
    for n in range(4):  # several processes append to one file, and each may begin another
        with (
            logging_to(path, f"first {n}", str, never),
            logging_to(path, f"second {n}", str, never),
        ):
            for number in range(5):
                EVENTS.info("line %d", number)
    names = {one.name for one in tmp_path.iterdir()}
    assert names == {"kb.log", *(f"kb.log.{n}" for n in range(1, 6))}
    assert all(one.stat().st_size <= 400 for one in tmp_path.iterdir())
    assert "second 3" in path.read_text(encoding="utf-8").splitlines()[-1]


def test_a_log_that_cannot_be_written_is_told_once(tmp_path: Path) -> None:
    told: list[str] = []
    (tmp_path / "file").touch()
    for path in (Path("/dev/full"), tmp_path, tmp_path / "file" / "kb.log"):
        told.clear()
        with logging_to(path, "build", str, told.append):
            for _ in range(3):
                EVENTS.info("line")
        assert len(told) == 1
        assert str(path) in told[0]


def warn(number: int) -> int:
    logging.getLogger("kb.test").warning("task %d is slow", number)
    return number


@pytest.mark.parametrize("engine", ["local", "dask"])
def test_lines_of_workers_are_written_by_the_parent(engine: str, tmp_path: Path) -> None:
    if engine == "dask":
        pytest.importorskip("distributed")
    path = tmp_path / "kb.log"
    with (
        logging_to(path, "youtube filter", str, never),
        make_executor(engine, workers=2, root=tmp_path) as pool,
    ):
        assert [pool.submit(warn, n).result() for n in range(3)] == [0, 1, 2]
    lines = path.read_text(encoding="utf-8").splitlines()
    assert sorted(line.rpartition("] ")[2] for line in lines) == [
        f"kb.test: task {n} is slow" for n in range(3)
    ]
    assert all("warning youtube filter[" in line for line in lines)
