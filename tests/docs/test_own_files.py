"""The blocks of docs/own-files.md, one after another, on the files of somebody who plays chess."""

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from tests.conftest import ROOT
from tests.installed import outside
from tests.youtube.ytdlp.folder import info, spoken, video_id, vtt

LIGHT = ROOT / "tests" / "light.py"
TEXT = (ROOT / "docs" / "own-files.md").read_text(encoding="utf-8")
BLOCKS = re.findall(r"^```bash\n(.*?)^```$", TEXT, re.MULTILINE | re.DOTALL)
SPEECH = (
    "welcome back today white opens with e four and black answers with the sicilian defense",
    "the knight goes to f three and then there is a fork of king and rook in this sicilian",
    "in the endgame the extra pawn decides and that is why the sicilian is so sharp",
    "thank you for watching and see you in the next game of this long and quiet match",
)


def files_of_a_player(place: Path, count: int = 8) -> None:
    """A folder of yt-dlp with videos of two channels, and a dump of a thread."""
    videos = place / "videos"
    videos.mkdir()
    for number in range(count):
        key = video_id(number)
        about = info(
            key, title=f"Sicilian game {number}", channel_id=f"UC{number % 2:022d}", tags=["chess"]
        )
        (videos / f"{key}.info.json").write_text(json.dumps(about))
        order = SPEECH[number % 4 :] + SPEECH[: number % 4]
        (videos / f"{key}.en.vtt").write_text(vtt(spoken(*order), automatic=True))
    post = {
        "id": "abc1",
        "subreddit": "chess",
        "author": "Rook-lift",
        "title": "Which line of the Sicilian defence?",
        "selftext": "Against e4 I always play the Sicilian defence.",
        "created_utc": 1_700_000_000,
        "score": 12,
        "num_comments": 1,
        "over_18": False,
        "url": "https://www.reddit.com/r/chess/comments/abc1/",
        "is_self": True,
    }
    comment = {
        "id": "def1",
        "subreddit": "chess",
        "author": "Bishop-pair",
        "body": "Try the closed lines first.",
        "link_id": "t3_abc1",
        "parent_id": "t3_abc1",
        "created_utc": 1_700_000_900,
        "score": 4,
    }
    (place / "dumps").mkdir()
    lines = "".join(json.dumps(line) + "\n" for line in (post, comment))
    (place / "dumps" / "chess.jsonl").write_text(lines)


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the files, and with `kb` as a light set-up has it."""
    folder = tmp_path_factory.mktemp("chess")
    files_of_a_player(folder)
    tools = folder / "bin"
    tools.mkdir()
    (tools / "kb").write_text(f'#!/bin/bash\nexec "{sys.executable}" "{LIGHT}" "$@"\n')
    (tools / "kb").chmod(0o755)
    return folder


def shell(place: Path, script: str) -> subprocess.CompletedProcess[str]:
    """Run it there. Without network: the process has no address to send to but loopback's."""
    unreachable = dict.fromkeys(("http_proxy", "https_proxy"), "http://127.0.0.1:9")
    tools = f"{place / 'bin'}{os.pathsep}{os.environ['PATH']}"
    return subprocess.run(
        ["bash", "-e", "-c", script],
        cwd=place,
        env={**outside(), **unreachable, "PATH": tools},
        capture_output=True,
        text=True,
        check=False,
        stdin=subprocess.DEVNULL,
        timeout=300,
    )


@pytest.mark.slow
def test_own_files_become_pairs_a_search_and_a_draw(place: Path) -> None:
    first, *rest = BLOCKS
    assert first.splitlines()[-1] == ". .venv/bin/activate"  # tests/package/test_setup.py
    done = shell(place, "".join(rest))
    assert done.returncode == 0, done.stdout + done.stderr
    out = done.stdout
    assert "profile check: 0 errors" in out
    assert re.search(r"^Sicilian Defence +\d+ +[5-8]$", out, re.MULTILINE)
    assert "reddit.com/r/chess/comments/abc1" in out
    assert "youtu" in out
    drawn = (place / "draw" / "videos.txt").read_text().split()
    assert 1 <= len(drawn) <= 3
    release = place / "data" / "chess" / "release"
    assert (release / "pairs" / "README.md").is_file()
    assert 'family-names: "Doe"' in (release / "pairs" / "CITATION.cff").read_text()
    assert "LIGHT" not in (release / "pairs" / "README.md").read_text(), "as on any machine"


def test_what_a_light_set_up_lacks_is_named_with_its_extra_and_the_command(place: Path) -> None:
    profile = place / "chess" / "profile.toml"
    root = place / "data" / "chess"
    if not root.exists():
        assert shell(place, "".join(BLOCKS[1:4])).returncode == 0
    text = profile.read_text().replace('toxicity = "off"', "")
    wiki = '[wiki]\nurl = "http://127.0.0.1:9/"\n\n[youtube]'
    profile.write_text(text.replace("[youtube]", wiki))
    (place / "model").mkdir()
    for words, extra in (
        ("clips --videos videos", "clips"),
        ("pairs score --videos videos --model model", "score"),
        ("annotate youtube", "toxicity"),
        ("wiki crawl", "wiki"),
        ("mcp", "mcp"),
        ("youtube filter --engine dask --scheduler tcp://127.0.0.1:9", "dask"),
    ):
        settings = "KB_DATA=data/chess KB_PROFILE=chess/profile.toml KB_CONTACT=a@chess-lab.net"
        done = shell(place, f"{settings} kb {words}")
        assert done.returncode == 2, (words, done.stderr)
        assert "make setup LIGHT=0" in done.stderr, (words, done.stderr)
        assert f'".[{extra}]"' in done.stderr, (words, done.stderr)
