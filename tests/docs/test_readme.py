"""README's blocks: what is shown with output is run and compared,
what needs a real service is at least a real command.
"""

import doctest
import json
import os
import re
import shlex
import subprocess
import sys
from pathlib import Path

import duckdb
import pytest

from kb.cli.app import TREE
from kb.explore import overview
from kb.explore.tables import CurrentTables
from tests import processes
from tests.cli.conftest import clean_environment
from tests.cli.test_app import COMMANDS
from tests.installed import outside

ROOT = Path(__file__).resolve().parents[2]
TEXT = (ROOT / "README.md").read_text(encoding="utf-8")


def blocks(language: str) -> list[str]:
    return re.findall(rf"^```{language}\n(.*?)^```$", TEXT, re.MULTILINE | re.DOTALL)


def sessions() -> list[tuple[str, str]]:
    """(command, output) of every `$ ` line of the console blocks;
    a command may go on over lines that end in a backslash.
    """
    found = []
    for block in blocks("console"):
        for part in re.split(r"^\$ ", block, flags=re.MULTILINE)[1:]:
            match = re.match(r"((?:[^\n]*\\\n)*[^\n]*)\n([\s\S]*)", part)
            assert match
            found.append((match[1], match[2]))
    return found


SESSIONS = sessions()


def test_there_are_queries_with_output() -> None:
    assert len([command for command, _ in SESSIONS if "kb query" in command]) >= 3


@pytest.mark.parametrize("number", range(len(SESSIONS)))
def test_what_is_shown_is_what_comes(number: int, demo: Path) -> None:
    command, wanted = SESSIONS[number]
    program, *words = shlex.split(command.replace("\\\n", " "))
    assert program == "kb"
    done = processes.run(words, env=clean_environment(), cwd=demo)
    assert done.returncode == 0, done.stderr
    assert done.stdout.rstrip() == wanted.rstrip()


def test_the_python_block_is_a_session_that_was_run(
    demo: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(demo)
    (block,) = blocks("python")
    test = doctest.DocTestParser().get_doctest(block, {}, "README.md", "README.md", 0)
    assert len(test.examples) >= 6
    said: list[str] = []
    doctest.DocTestRunner().run(test, out=said.append)
    assert not said, "".join(said)
    assert (demo / "saltstone.png").is_file()


def test_a_number_that_is_shown_twice_is_the_same(demo: Path) -> None:
    """By report, explore, status, the filters' summaries, the cards, and README's pictures."""
    root = demo / "data" / "demo"
    page = (root / "report" / "index.html").read_text(encoding="utf-8")
    report = {what: n for n, what in re.findall(r"<div><b>([^<]+)</b>([^<]+)</div>", page)}
    explore = {noun: n for n, noun in overview.read(CurrentTables(root), {})["totals"]}
    assert explore.keys() == report.keys()
    for noun, n in report.items():
        exact = float(explore[noun].replace(",", ""))
        shown = float(n.replace(",", "").removesuffix("k")) * (1000 if n.endswith("k") else 1)
        assert shown == pytest.approx(exact, abs=50 if n.endswith("k") else 0), noun
    words = ["status", "--json", "--data", str(root)]
    done = processes.run(words, env=clean_environment(), cwd=demo)
    about = json.loads(done.stdout.splitlines()[-1])
    for source, facts in about["sources"].items():
        made = json.loads((root / "clean" / source / "summary.json").read_text(encoding="utf-8"))
        card = (root / "release" / source / "README.md").read_text(encoding="utf-8")
        for table, n in facts["released"].items():
            assert made["tables"][f"{source}/{table}"] == facts["rows"][table] == n
            assert f" {n:,} rows, " in card
            assert explore.get(table, f"{n:,}") == f"{n:,}"
        stages = dict(re.findall(r"^\| (\w+) \| ([\d,]+) \|$", card, re.MULTILINE))
        dropped = {stage: f"{n:,}" for stage, n in made["stages"].items() if n}
        assert dropped.items() <= stages.items()
    for folder in sorted((root / "release").glob("*/")):  # every card counts the rows beside it
        card = (folder / "README.md").read_text(encoding="utf-8")
        tables = {path.name.partition("-")[0] for path in folder.glob("*-of-*.parquet")}
        for table in tables:
            ((n,),) = duckdb.sql(f"SELECT count(*) FROM '{folder}/{table}-*.parquet'").fetchall()
            assert re.search(rf"^### {table}\n\n.* {n:,} rows, ", card, re.MULTILINE), table
    assert explore["video-text pairs"] == f"{about['pairs']['clean']:,}"
    (pictured,) = re.findall(r"totals from ([\d,]+) videos to ([\d,]+) mentions", TEXT)
    thousands = f"{float(report['mentions'].removesuffix('k')) * 1000:,.0f}"
    assert pictured == (report["videos"], thousands)
    assert f" of {report['videos']} videos are kept" in TEXT


def test_commands_that_are_only_shown_exist() -> None:
    lines = [
        line.split("  #")[0].split(" #")[0].strip()
        for block in (*blocks("bash"), *blocks(""))
        for line in block.splitlines()
    ]
    targets = set(re.findall(r"^([a-z-]+):", (ROOT / "Makefile").read_text(), re.MULTILINE))
    checked = 0
    for line in lines:
        words = shlex.split(line) if line.startswith(("kb ", "make ")) else []
        if words[:1] == ["make"]:
            assert {word for word in words[1:] if "=" not in word} <= targets, line
            checked += 1
        elif words:
            name = " ".join(words[1:3]) if " ".join(words[1:3]) in COMMANDS else words[1]
            assert name in COMMANDS, line
            known = {option for parameter in COMMANDS[name].params for option in parameter.opts}
            assert {word for word in words if word.startswith("--") and word != "--"} <= known, line
            checked += 1
    assert checked >= 8


EDITOR = """\
import pathlib, sys
FILLED = {
    'youtube.category_ids = ["FILL-IN"]': "youtube.category_ids = [26]",
    'wiki.url = "FILL-IN"': 'wiki.url = "https://gardening.wiki"',
    'reddit.subreddit = "FILL-IN"': 'reddit.subreddit = "gardening"',
    "FILL-IN\\tkind": "Secateurs\\ttool",
}
for path in map(pathlib.Path, sys.argv[1:]):
    text = path.read_text()
    for old, new in FILLED.items():
        text = text.replace(old, new)
    path.write_text(text)
"""


@pytest.mark.wheel
def test_another_domain_is_set_up_as_it_is_written_there(tmp_path: Path, installed: Path) -> None:
    """Word for word, with an editor that fills in four lines."""
    (tmp_path / "editor.py").write_text(EDITOR)
    part = TEXT[TEXT.index("## Another domain") :]
    block = part[part.index("```bash") + len("```bash") : part.index("\n```\n")]
    done = subprocess.run(
        ["bash", "-e", "-c", block],
        cwd=tmp_path,
        env={
            **outside(),
            "PATH": f"{installed}:{os.environ['PATH']}",
            "EDITOR": f"{sys.executable} editor.py",
        },
        capture_output=True,
        text=True,
        check=False,
        stdin=subprocess.DEVNULL,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    assert "profile check: 0 errors" in done.stdout
    assert "youtube crawl" in done.stdout
    assert re.search(r"^Secateurs +\d", done.stdout, re.MULTILINE)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["data", "editor.py", "gardening"]
    assert [path.name for path in (tmp_path / "data").iterdir()] == ["gardening-demo"]
    release = tmp_path / "data" / "gardening-demo" / "demo" / "release"
    for folder in release.glob("*/"):
        card = (folder / "README.md").read_text(encoding="utf-8")
        assert "Gardening" in card
        assert "Minecraft" not in card


def test_the_table_of_commands_is_whole() -> None:
    table = TEXT[TEXT.index("## Commands") : TEXT.index("## ", TEXT.index("## Commands") + 3)]
    for name in TREE:
        assert f"kb {name}" in table or "`kb … " in table, name
    for target in re.findall(r"^([a-z-]+):.*##", (ROOT / "Makefile").read_text(), re.MULTILINE):
        if target not in ("help", "lock", "reference"):
            assert target in TEXT, target


def test_links_lead_somewhere() -> None:
    for link in re.findall(r"\]\(([^)#]+)\)", TEXT):
        if "://" not in link:
            assert (ROOT / link).exists(), link
    pictures = {Path(one).name for one in re.findall(r'<img src="([^"]+)"', TEXT)}
    assert pictures
    for page in (ROOT / "docs").glob("*.md"):
        pictures |= set(re.findall(r"!\[[^]]*\]\(([^)]+\.png)\)", page.read_text()))
    assert {path.name for path in (ROOT / "docs").glob("*.png")} == pictures
