"""How imports, updates and draws end: exit code, the command that is named, what is left behind."""

import json
from pathlib import Path

import pytest

from kb.artifacts.data_roots import is_root
from tests import inprocess
from tests.cli.conftest import clean_environment

POST = {
    "id": "abc123",
    "title": "x",
    "subreddit": "Minecraft",
    "author": "a",
    "created_utc": 1_600_000_000,
}
VIDEO = {"id": "dQw4w9WgXcQ", "title": "x", "extractor_key": "Youtube", "duration": 100}
# Words → exit code, what the line on stderr names, whether there is a data root afterwards.
ENDS: dict[str, tuple[int, str, bool]] = {
    "youtube import dumps": (1, "run `kb reddit import dumps", False),
    "youtube import dumps/posts.jsonl": (2, "run `kb reddit import dumps/posts.jsonl", False),
    "youtube import --own-transcripts dumps": (1, "run `kb reddit import dumps", False),
    "reddit import videos": (2, "run `kb youtube import videos", False),
    "reddit import videos/dQw4w9WgXcQ.info.json": (2, "run `kb youtube import videos/", False),
    "reddit import videos/dQw4w9WgXcQ.en.vtt": (2, "run `kb youtube import videos/", False),
    "youtube import others": (1, "run yt-dlp", False),
    "youtube import none": (2, "is not a folder", False),
    "youtube import": (2, "there is no folder to import", False),
    "reddit import others": (2, "contains no dumps", False),
    "reddit import others/list.json": (2, "none is a post or comment", False),
    "reddit import none": (2, "cannot read none", False),
    "youtube import videos": (0, "", True),
    "youtube import videos --limit 1": (3, "--limit 1 reached", True),
    "youtube import videos dumps": (0, "", True),
    "reddit import dumps": (0, "", True),
    "reddit import dumps --limit 1": (3, "", True),
    "reddit import empty.zst": (0, "", True),
    "update": (2, "there is no data root", False),
    "pairs draw 5": (2, "there is no data root", False),
    "pairs draw 5 --plan --out there": (2, "there is no data root", False),
    "pairs draw 0": (2, "", False),
}


@pytest.fixture
def place(tmp_path: Path) -> Path:
    for name in ("dumps", "videos", "others"):
        (tmp_path / name).mkdir()
    lines = [json.dumps({**POST, "id": f"abc12{n}"}) for n in range(3)]
    (tmp_path / "dumps" / "posts.jsonl").write_text("\n".join(lines) + "\n")
    (tmp_path / "empty.zst").write_bytes(b"")
    (tmp_path / "others" / "notes.txt").write_text("nothing of either\n")
    (tmp_path / "others" / "list.json").write_text('{"name": "something else"}\n')
    (tmp_path / "videos" / "dQw4w9WgXcQ.info.json").write_text(json.dumps(VIDEO))
    cue = "WEBVTT\n\n00:00:01.000 --> 00:00:02.000\nhello there\n"
    (tmp_path / "videos" / "dQw4w9WgXcQ.en.vtt").write_text(cue)
    return tmp_path


@pytest.mark.parametrize("words", ENDS)
def test_the_exit_code_the_command_that_is_named_and_the_root(place: Path, words: str) -> None:
    code, named, made = ENDS[words]
    done = inprocess.run([*words.split(), "--data", "data"], env=clean_environment(), cwd=place)
    assert done.code == code, done.err
    assert named in done.said
    assert is_root(place / "data") == made
    assert (place / "data").exists() == made


def test_a_failed_import_leaves_what_was_there(place: Path) -> None:
    def code(words: str) -> int:
        return inprocess.run(words.split(), env=clean_environment(), cwd=place).code

    assert code("reddit import dumps --data data") == 0
    before = {path for path in (place / "data").rglob("*") if path.is_file()}
    assert code("youtube import dumps --data data") == 1
    assert before <= {path for path in (place / "data").rglob("*") if path.is_file()}
    assert code("pairs draw 5 --data data") == 1  # there are no pairs
    (place / "own").mkdir()
    (place / "own" / "mine.txt").write_text("mine")
    assert code("youtube import dumps --data own") == 1
    assert [path.name for path in (place / "own").iterdir()] == ["mine.txt"]
