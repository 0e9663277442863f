"""A fourth source is a package of its own, and nothing of Lorecrawl is edited for it.

The test installs tests/fourth/package and takes its source through every command.
"""

import json
import os
import re
import shutil
import signal
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pyarrow.dataset as ds
import pytest
from anyio.from_thread import start_blocking_portal

from kb.sandbox.toxicity import tiny_checkpoint
from tests.cli.conftest import clean_environment
from tests.fourth.service import KEY, Site, serving

PACKAGE = Path(__file__).resolve().parent / "package"
PROFILE = """
name = "things"
title = "Things"
toxicity = "off"
[qanda]
url = "{url}"
units_per_day = {units}
[pairs]
include = ["thing 107"]
[release]
contact = "me@things.org.uk"
creators = [{{ name = "Someone" }}]
licenses = {{ qanda = "CC-BY-SA-4.0", pairs = "CC-BY-SA-4.0" }}
"""
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


def install(place: Path, package: Path = PACKAGE) -> Path:
    """The folder with the installed package, from its own folder alone."""
    options = [
        "-q",
        "--no-deps",
        "--no-build-isolation",
        "--no-index",
        "--disable-pip-version-check",
    ]
    copied = shutil.copytree(package, place / "copy")
    words = [sys.executable, "-m", "pip", "install", *options, "--target", str(place / "site")]
    subprocess.run([*words, str(copied)], check=True)
    return place / "site"


@pytest.fixture(scope="module")
def installed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return install(tmp_path_factory.mktemp("package"))


class Place:
    """A folder with a data root, where commands of the installed source run."""

    def __init__(self, folder: Path, installed: Path, site: Site) -> None:
        self.folder, self.root, self.site = folder, folder / "root", site
        self.environment = {**clean_environment(), "PYTHONPATH": str(installed), "QANDA_KEY": KEY}
        self.profile()

    def profile(self, units: int = 300, *, scored: bool = False) -> None:
        text = PROFILE.format(url=self.site.root, units=units)
        if scored:
            text = text.replace('toxicity = "off"\n', "") + "[toxicity.thresholds]\nqanda = 0.5\n"
        (self.folder / "profile.toml").write_text(text)

    def start(
        self, *commands: str, root: str = "root", **environment: str
    ) -> "subprocess.Popen[str]":
        words = json.dumps([command.split() for command in commands])
        options = ["--data", root, "--json", "--profile", "profile.toml"]
        return subprocess.Popen(
            [sys.executable, "-c", COMMANDS, words, *options],
            cwd=self.folder,
            env=self.environment | environment,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )

    def fails(self, command: str, root: str = "root", **environment: str) -> tuple[int, str]:
        """The exit code of a command, and its last line."""
        process = self.start(command, root=root, **environment)
        _, errors = process.communicate(timeout=120)
        return process.returncode, errors.strip().splitlines()[-1]

    def run(self, *commands: str, root: str = "root") -> list[dict[str, Any]]:
        """The summaries of commands that all end well."""
        process = self.start(*commands, root=root)
        out, errors = process.communicate(timeout=120)
        assert process.returncode == 0, out + errors
        return [json.loads(line) for line in out.splitlines() if line.startswith("{")]

    def python(self, code: str) -> str:
        """What code prints in a process that has the package."""
        words = [sys.executable, "-c", code]
        return subprocess.run(
            words, cwd=self.folder, env=self.environment, capture_output=True, text=True, check=True
        ).stdout

    def released(self, table: str) -> list[str]:
        """The keys of a released table."""
        shards = sorted((self.root / "release/qanda").glob(f"{table}-*.parquet"))
        return [str(key) for key in ds.dataset(shards).to_table()[f"{table[:-1]}_id"].to_pylist()]


Make = Callable[[int], Place]


@pytest.fixture
def place(tmp_path: Path, installed: Path) -> Iterator[Place]:
    """A place with a site of ten questions."""
    with serving(Site(10)) as site:
        yield Place(tmp_path, installed, site)


def lines(pattern: str) -> int:
    """Lines of the package's files that are not blank."""
    texts = (path.read_text() for path in PACKAGE.rglob(pattern) if "build" not in path.parts)
    return sum(bool(line.strip()) for text in texts for line in text.splitlines())


def test_the_package_is_small() -> None:
    about = sum(lines(name) for name in ("about.toml", "pyproject.toml"))
    assert lines("*.py") <= 180
    assert lines("*.toml") - about + lines("*.json") <= 120


def test_a_crawl_keeps_to_key_and_quota_and_resumes(place: Place) -> None:
    code, line = place.fails("qanda crawl", QANDA_KEY="")
    assert (code, "QANDA_KEY is not set" in line) == (2, True)
    assert not place.site.asked
    code, line = place.fails("qanda crawl", QANDA_KEY="some-other-secret")
    assert (code, "refuses the key" in line, "some-other" in line) == (1, True, False)
    place.profile(units=5)  # one is spent
    code, line = place.fails("qanda crawl")
    assert (code, "quota of 5 units a day is spent" in line) == (3, True)
    assert place.site.asked.total() == 5
    place.profile()
    (crawled,) = place.run("qanda crawl")
    assert (crawled["pending"], crawled["left"], place.site.asked.total()) == (0, 0, 12)


def test_a_killed_crawl_goes_on(place: Place) -> None:
    asked, go_on = threading.Event(), threading.Event()

    def waits(path: str) -> None:
        if path.endswith("/answers"):
            asked.set()
            go_on.wait(60)

    place.site.fault = waits
    process = place.start("qanda crawl")
    assert asked.wait(60)
    process.send_signal(signal.SIGKILL)
    process.communicate()
    go_on.set()
    place.site.fault = lambda path: None
    (filtered,) = place.run("qanda filter")  # of questions alone
    assert (filtered["kept"], filtered["rejected"]) == (2, 2)
    before = place.site.asked["/questions"]
    place.run("qanda crawl")
    assert place.site.asked["/questions"] in (3, before + 3 - before % 3)
    (filtered,) = place.run("qanda filter")
    assert (filtered["kept"], filtered["rejected"]) == (16, 14)


def test_from_crawl_to_purge(place: Place) -> None:
    """crawl → build → read → refresh → purge → update."""
    planned, crawled, *_ = place.run("qanda crawl --plan", "qanda crawl", "build")
    assert (planned["requests"], crawled["crawled"], crawled["units"]) == (1, 10, 11)
    kept = [str(key) for key in range(103, 111)]
    assert place.released("questions") == kept
    assert place.released("answers") == [f"{key}0" for key in kept]  # others have negative scores
    card = (place.root / "release/qanda/README.md").read_text()
    assert "Questions about Things and their answers" in card
    assert "kb restore . --data ../restored    # titles and texts, with your own QANDA_KEY" in card
    croissant = json.loads((place.root / "release/qanda/croissant.json").read_text())
    assert {"questions", "answers"} <= {one["@id"] for one in croissant["recordSet"]}
    query = "kb.load('root/release/qanda').sql('SELECT min(score) FROM qanda_questions')"
    assert place.python(f"import kb; print([*next(iter({query})).values()])") == "[0]\n"
    answer, status = place.run("search furnace --kind answer", "status")
    assert {one["key"] for one in answer["answers"]} == {f"a{key}0" for key in kept}
    assert (status["sources"]["qanda"]["crawled_so_far"], status["left"]) == (10, 0)
    assert "Thing 107 needs a furnace" in read(place, "qanda:107/1070")

    place.site.deleted, place.site.ids = {105}, [*place.site.ids, 111]
    (place.folder / "gone.txt").write_text("107\n")
    purge = "purge qanda --ids gone.txt"
    refreshed, planned, purged, again = place.run(
        "refresh qanda --older-than 0", f"{purge} --plan", purge, purge
    )
    assert (refreshed["crawled"], refreshed["requests"]) == (10, 1)
    assert [one["purged"] for one in (planned, purged, again)] == [1, 1, 0]
    left = [key for key in kept if key not in ("105", "107")]
    assert place.released("questions") == left
    assert place.released("answers") == [f"{key}0" for key in left]
    assert "1050" not in "".join(map(str, raw(place)))
    updated, verified = place.run("update", "verify")
    assert updated["made"] > 0
    assert place.released("questions") == [*left, "111"]
    assert verified["files_damaged"] == 0
    assert place.site.asked["/questions/107/answers"] == 0


@pytest.mark.slow
def test_a_download_is_restored(place: Place) -> None:
    """Interrupted, resumed, after a deletion; what is purged leaves the restored rows as well."""
    place.run("qanda crawl", "build")
    shutil.copytree(place.root / "release/qanda", place.folder / "download")
    place.site.deleted = {105}
    place.site.fault = lambda path: 500 if "answers" in path else None
    (planned,) = place.run("restore download --plan", root="mine")
    assert [(phase["items"], phase["requests"]) for phase in planned["phases"]] == [(8, 1)]
    (failed,) = place.run("restore download", root="mine")
    assert (failed["questions"], failed["failed"]) == (0, 7)
    assert not rows(place.folder / "mine/restored/qanda/questions")  # not without their answers
    place.site.fault = lambda path: None
    before = place.site.asked.total()
    place.site.deleted = {*range(103, 111)}
    code, line = place.fails("restore download", root="late")
    assert (code, "none of 8 questions could be read" in line) == (1, True), line
    lost = rows(place.folder / "late/restored/missing.parquet")
    assert [one["reason"] for one in lost] == ["missing"] * 8
    place.site.deleted = {105}
    done, again = place.run("restore download", "restore download", root="mine")
    kept = [str(key) for key in range(103, 111) if key != 105]
    assert restored(place, "questions") == kept
    assert restored(place, "answers") == sorted(f"{key}{n}" for key in kept for n in (0, 1))
    assert (done["questions"], done["missing"], again["requests"]) == (7, 1, 0)
    assert place.site.asked.total() - before <= 6
    (gone,) = rows(place.folder / "mine/restored/missing.parquet")
    assert gone == {"source": "qanda", "part": "questions", "key": "105", "reason": "missing"}
    (place.folder / "gone.txt").write_text("105\n107\n")
    place.run("purge qanda --ids gone.txt", root="mine")
    assert not rows(place.folder / "mine/restored/missing.parquet")
    before = place.site.asked.total()
    place.run("restore download", root="mine")
    lost = rows(place.folder / "mine/restored/missing.parquet")
    assert [(one["key"], one["reason"]) for one in lost] == [("105", "purged"), ("107", "purged")]
    assert place.site.asked.total() == before
    kept.remove("107")
    assert restored(place, "questions") == kept
    assert restored(place, "answers") == sorted(f"{key}{n}" for key in kept for n in (0, 1))


def restored(place: Place, table: str) -> list[str]:
    """The keys of a restored table, in order, with texts in each row."""
    key, sql = f"{table[:-1]}_id", f"FROM restored.qanda_{table} WHERE body IS NOT NULL"
    answers = place.python(
        f"import kb; print(*(row['{key}'] for row in kb.load('mine').sql('{sql} ORDER BY {key}')))"
    )
    return answers.split()


def rows(place: Path) -> list[dict[str, Any]]:
    """The rows of a Parquet file or of those in a folder, none without any."""
    return ds.dataset(place).to_table().to_pylist() if place.exists() else []


def test_two_machines_share_a_crawl(place: Place) -> None:
    """crawl --part → merge → filter → verify --repair, and listed ids alone."""
    (first,) = place.run("qanda crawl --part 1/2", root="one")
    (second,) = place.run("qanda crawl --part 2/2", root="two")
    assert first["crawled"] + second["crawled"] == 10
    assert min(first["crawled"], second["crawled"]) > 0
    _, filtered = place.run("merge one two", "qanda filter")
    assert (filtered["kept"], filtered["rejected"]) == (16, 14)
    (shard,) = (place.root / "clean/qanda/questions").glob("*.parquet")
    whole = shard.read_bytes()
    shard.write_bytes(whole[:-9])
    place.run("verify --repair")
    assert shard.read_bytes() == whole
    (place.folder / "ids.txt").write_text("104\n105\n999\n")
    (listed,) = place.run("qanda crawl --ids ids.txt", root="listed")
    assert (listed["crawled"], listed["failed"], listed["requests"]) == (3, 0, 2)


def test_its_texts_are_scored_and_toxic_ones_rejected(place: Place) -> None:
    """By the filter and by `kb annotate`, by the threshold in the profile."""
    place.profile(scored=True)
    place.environment["KB_TOXICITY_MODEL"] = str(tiny_checkpoint())
    place.site.body = lambda key: "You are an idiot." if key == 107 else f"What is thing {key}?"
    _, annotated, filtered, *_ = place.run("qanda crawl", "annotate qanda", "qanda filter")
    assert (annotated["scored"], filtered["kept"], filtered["stages"]["toxicity"]) == (16, 14, 1)
    (row,) = json.loads(
        place.python(
            "import json, kb; print(json.dumps(list(kb.load('root').sql("
            "'SELECT key, reason, threshold FROM qanda_rejected WHERE stage = \\'toxicity\\''))))"
        )
    )
    assert row == {"key": "q107", "reason": "body", "threshold": "0.5"}


def test_its_key_is_asked_for_and_shown_nowhere(place: Place) -> None:
    """`kb doctor` names the setting; a key in `.env` is as good, and is in no file and message."""
    (checked,) = place.run("doctor")
    lines = {line["what"]: line for line in checked["checks"]}
    assert (lines["QANDA_KEY"]["state"], lines["QANDA_KEY"]["found"]) == ("ok", "set")
    del place.environment["QANDA_KEY"]
    (checked,) = place.run("doctor")
    (line,) = [line for line in checked["checks"] if line["what"] == "QANDA_KEY"]
    assert (line["state"], line["found"]) == ("note", "not set")
    assert "the questions and answers' API" in line["fix"]
    code, told = place.fails("qanda crawl")
    assert (code, "`kb doctor " in told, "lists every one" in told) == (2, True, True)
    (place.folder / ".env").write_text("QANDA_KYE=mistyped\n")
    _, warned = place.start("status").communicate(timeout=120)
    assert "did you mean QANDA_KEY?" in warned
    (place.folder / ".env").write_text(f"QANDA_KEY={KEY}\n")
    place.site.title = lambda key: f"Is {KEY} my key?"
    place.run("qanda crawl", "qanda filter")
    for path in place.root.rglob("*"):
        assert not path.is_file() or KEY.encode() not in path.read_bytes(), path
    assert KEY not in "".join(map(str, raw(place)))


@pytest.mark.dask
def test_a_cluster_makes_the_same_tables(place: Place) -> None:
    _, local, cluster = place.run(
        "qanda crawl", "qanda filter", "qanda filter --engine dask --workers 1"
    )
    assert (local["kept"], local["rejected"]) == (cluster["kept"], cluster["rejected"])


def raw(place: Place) -> Iterator[str]:
    """What is left of the answers, as the data root has them."""
    from kb.store.rawlog import rawlog

    for segment in rawlog.all_segments(place.root, "qanda"):
        for frame in rawlog.Frames(segment):
            yield str(frame)


def read(place: Place, ref: str) -> str:
    """What an agent reads over MCP."""
    from mcp import Client
    from mcp.client.stdio import StdioServerParameters, stdio_client

    words = ["-m", "kb", "mcp", "--data", str(place.root)]
    server = StdioServerParameters(command=sys.executable, args=words, env=place.environment)
    with (
        start_blocking_portal() as portal,
        portal.wrap_async_context_manager(Client(stdio_client(server))) as client,
    ):
        answer = portal.call(client.call_tool, "read", {"ref": ref})
        return str(answer.content[0].text)


@pytest.mark.parametrize(
    ("file", "before", "after", "problem"),
    [
        ("sources/qanda.toml", 'main = "questions"', "main = 3", r"sources/qanda\.toml: .*main"),
        ("sources/qanda.toml", 'answers = "a"', 'answers = "q"', "a key of answers"),
        ("sources/qanda.toml", 'kinds = ["question", "answer"]\n', "", "`kinds` says nothing"),
        ("sources/qanda.toml", "[settings.qanda_key]", "[settings.other]", "setting qanda_key"),
        ("tables/qanda/answers.toml", '"question_id"', '"question"', "`restored` needs the column"),
        ("tables/qanda/answers.toml", "items[].score", "items[].votes", r"column score: .*votes"),
        ("raw/qanda/pages.json", '"x-keys"', "x-keys", r"raw/qanda/pages\.json: not readable"),
    ],
)
def test_a_wrong_package_is_one_line(
    installed: Path, tmp_path: Path, file: str, before: str, after: str, problem: str
) -> None:
    site = shutil.copytree(installed, tmp_path / "site")
    path = site / "qanda/schemas" / file
    assert before in path.read_text()
    path.write_text(path.read_text().replace(before, after))
    done = subprocess.run(
        [sys.executable, "-m", "kb", "qanda", "crawl", "--data", str(tmp_path / "root")],
        env={**clean_environment(), "PYTHONPATH": os.pathsep.join([str(site)])},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 2, done.stderr
    (line,) = done.stderr.splitlines()
    assert re.search(problem, line)
