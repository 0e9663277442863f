"""A download stays as it is, whatever is run on it and wherever it is typed; and a data root that
is not there is never made by a command that needs one.
"""

import hashlib
import re
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

import kb
from kb.cli.app import leaves
from kb.core.errors import UsageError
from kb.core.sources import SOURCES
from kb.report import build as report_build
from tests import inprocess, processes
from tests.cli.conftest import clean_environment
from tests.inprocess import Done
from tests.release.conftest import (
    released,  # noqa: F401  a fixture
)

COMMANDS = dict(leaves())
# What a command needs to be complete; files are those of the folder `files`.
WORDS = {
    "youtube import": "{files}",
    "reddit import": "{files}/dump.ndjson",
    "restore": "{above} --plan",
    "clips": "--videos {files}",
    "label export": "pairs",
    "label import": "{files}/answers.json",
    "pairs draw": "10",
    "pairs score": "--videos {files} --model {files}/ids.txt",
    "merge": "{files}",
    "diff": "{above} {above}",
    "query": "FROM\tpairs",
    "release publish": "--to zenodo",
    "search": "wolf",
    "profile new": "gardening",
    "sandbox": "--no-model -- true",
    "explore": "--no-browser",
}
# They read a download; what they make of it goes elsewhere. With the option that names where.
READING = {
    "clips": "--out {out}",
    "explore": "",
    "index": "",
    "label export": "--out {out}",
    "links": "",
    "mcp": "",
    "pairs draw": "--out {out}",
    "pairs keywords": "",
    "profile check": "",
    "profile keywords": "",
    "query": "",
    "report": "",
    "search": "",
    "status": "",
    "verify": "",
    "youtube missing-transcripts": "",
}
WITHOUT_DATA = {"diff", "doctor", "models fetch", "profile new", "sandbox"}
MAKING = {
    *("demo", "merge", "reddit crawl", "reddit import", "reddit reconstruct", "restore"),
    *("wiki crawl", "youtube crawl", "youtube import"),
}
WRITING = [name for name in COMMANDS if name not in {*READING, *WITHOUT_DATA, *MAKING}]
SERVING = ("explore", "mcp")  # until they are asked to end
# Options with a path that a command reads.
READ = {
    *("authors", "channels", "dumps", "file", "from_index", "ids", "model", "own_transcripts"),
    *("pairs", "pipeline", "profile", "source", "titles", "tokenizer", "videos"),
    "data",  # has its own tests
}


@pytest.fixture(scope="module")
def above(
    released: Path,  # noqa: F811
    tmp_path_factory: pytest.TempPathFactory,
) -> Path:
    """A folder above several downloads."""
    return Path(shutil.copytree(released / "release", tmp_path_factory.mktemp("far") / "downloads"))


@pytest.fixture
def unchanged(above: Path) -> Iterator[None]:
    """Asserts that no file or folder of the downloads changes, and that none appears."""
    before = listing(above)
    yield
    assert listing(above) == before


@pytest.fixture
def files(tmp_path: Path) -> Path:
    """A file of each kind that commands ask for."""
    folder = tmp_path / "files"
    folder.mkdir()
    (folder / "ids.txt").write_text("dQw4w9WgXcQ\n")
    (folder / "dump.ndjson").write_text("")
    (folder / "answers.json").write_text("[]")
    return folder


@pytest.fixture
def typed(above: Path, files: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Any:
    """A command with all that it needs, typed in a folder."""
    monkeypatch.setattr(report_build, "_drawn", lambda *_: [])  # figures take seconds

    def run(name: str, *more: str, cwd: Path = files) -> Done:
        places = {"files": files, "above": above, "out": tmp_path / "out"}
        words = [*name.split(), *more, *options_of(WORDS.get(name, ""), places)]
        return inprocess.run(words, env=environment(tmp_path), cwd=cwd)

    return run


def options_of(words: str, places: dict[str, Path]) -> list[str]:
    return [word.replace("\t", " ") for word in words.format(**places).split(" ") if word]


def environment(tmp_path: Path) -> dict[str, str]:
    cache = {"XDG_CACHE_HOME": str(tmp_path / "cache"), "KB_NOW": "2026-11-10T00:00:00Z"}
    return {**clean_environment(), **cache}


@pytest.mark.parametrize("name", [*WRITING, *sorted(MAKING)])
@pytest.mark.usefixtures("unchanged")
def test_a_command_that_writes_refuses_a_download(name: str, above: Path, typed: Any) -> None:
    for place in (above, above / "pairs"):
        done = typed(name, "--data", str(place))
        assert (done.code, done.out) == (2, "")
        assert f"{place} is a download" in done.said
        assert "a download stays as it is; name another place with --data" in done.said
        done = typed(name, cwd=place)
        if name == "restore":  # beside it
            assert done.code == 0, done.err
        else:
            expected = "is inside the download" if name in MAKING else "there is no data root"
            assert (done.code, expected in done.said) == (2, True)


@pytest.mark.parametrize("name", [name for name in READING if name not in SERVING])
@pytest.mark.usefixtures("unchanged")
def test_a_command_that_reads_leaves_a_download_as_it_is(
    name: str, above: Path, typed: Any, tmp_path: Path
) -> None:
    where = options_of(READING[name], {"out": tmp_path / "out"})
    for place in (above, above / "pairs"):
        for cwd, data in ((tmp_path, str(place)), (place, ".")):
            shutil.rmtree(tmp_path / "out", ignore_errors=True)
            done = typed(name, *where, "--data", data, cwd=cwd)
            assert "unexpected" not in done.err
            assert refusing_a_download(done) == []
            if where:
                assert (done.code, (tmp_path / "out").is_dir()) == (0, True), done.err
                assert typed(name, "--data", data, cwd=place).code == 2  # the default is here


@pytest.mark.usefixtures("unchanged")
def test_what_a_download_lacks_is_not_asked_of_commands_that_refuse_it(
    above: Path, typed: Any, tmp_path: Path
) -> None:
    """`kb restore` brings it back, from the download that it names."""
    out = tmp_path / "out"
    exports = [f"{s} export --format {f}" for s in SOURCES for f in ("text", "minedojo")]
    pairs = (
        "pairs draw",
        "pairs draw --aligned",
        "pairs draw --release",
        "clips",
        "clips --aligned",
    )
    labels = ("label export", "label export --aligned")
    for line in (*exports, *pairs, *labels):
        words, more = line.partition(" --")[0], line.split()[2:]
        if words == "clips":
            more = line.split()[1:]
        done = typed(words, *more, "--out", str(out), "--data", str(above / "tasks"))
        assert (done.code in (1, 2), out.exists()) == (True, False), done
        assert "unexpected" not in done.err
        assert refusing_a_download(done) == []
        assert f"`kb restore {above / 'tasks'}`" in done.said or "--release" in more
    done = typed("youtube export", "--format", "text", "--out", str(out), "--data", str(above))
    assert (done.code, out.exists()) == (1, False)
    assert "has no content of youtube/transcripts; a download" in done.said
    done = typed("search", "--data", str(above / "tasks"))
    assert f"`kb restore {above / 'tasks'}` brings back" in done.said


def refusing_a_download(done: Done) -> list[str]:
    """The commands in messages that a download would refuse."""
    named = re.findall(r"`kb ([a-z- ]+)", done.out + done.err)
    refusing = {*WRITING, *MAKING} - {"demo", "restore"}
    return [words for words in named if refusing & {words.strip(), " ".join(words.split()[:2])}]


@pytest.mark.parametrize("name", SERVING)
@pytest.mark.usefixtures("unchanged")
def test_a_server_leaves_a_download_as_it_is(name: str, above: Path, tmp_path: Path) -> None:
    words = (name, *WORDS.get(name, "").split(), "--data", ".")
    process = processes.start(words, env=environment(tmp_path), cwd=above)
    if name == "explore":
        process.lines(1)
        process.send_signal(15)
    assert process.wait(60) in (0, 3), process.output()


@pytest.mark.usefixtures("unchanged")
def test_no_option_writes_into_a_download(above: Path, typed: Any) -> None:
    written = 0
    for name, command in COMMANDS.items():
        for option in command.params:
            if option.param_type_name != "option" or option.name in READ or not names_path(option):
                continue
            place = above / "pairs" / "new"
            if option.name == "log":  # changes no exit code
                continue
            done = typed(name, option.opts[0], str(place), cwd=above)
            assert (done.code, f"{place} is inside the download" in done.said) == (2, True), name
            assert f"name another place with {option.opts[0]}" in done.said
            written += 1
    assert written > 10
    done = typed("query", "--log", str(above / "log"), "--data", str(above))
    assert "the log is not written" in done.err
    done = typed("query", "--out", str(above / "new.csv"), "--data", str(above))
    assert (done.code, f"{above}, which this command only reads" in done.said) == (2, True)
    assert typed("profile new", cwd=above / "pairs").code == 2
    assert typed("doctor", cwd=above / "pairs").code == 1


def test_what_was_left_in_a_download_does_not_make_it_a_data_root(
    above: Path, typed: Any, files: Path, tmp_path: Path
) -> None:
    copy = Path(shutil.copytree(above, tmp_path / "downloads"))
    for place in (copy, copy / "pairs"):
        (place / "state").mkdir()
        (place / "state" / "pairs.lock").touch()
        assert typed("build", "--data", str(place)).code == 2
    env = environment(tmp_path)
    plans = [
        inprocess.run(["restore", place, "--plan"], env=env, cwd=files) for place in (above, copy)
    ]
    assert [plan.code for plan in plans] == [0, 0]
    assert plans[0].out == plans[1].out
    done = typed("verify", str(copy))
    assert done.code == 1
    (line,) = (line for line in done.out.splitlines() if line.startswith("foreign: "))
    assert line.startswith(f"foreign: {copy / 'pairs' / 'state'}: a release is flat")


def test_a_restore_that_is_typed_in_a_download_goes_beside_it(
    above: Path, files: Path, tmp_path: Path
) -> None:
    place = Path(shutil.copytree(above / "reddit", tmp_path / "downloads" / "reddit"))
    words = ["restore", ".", "--only", "reddit", "--dumps", files / "dump.ndjson"]
    before = listing(place)
    for _ in range(2):  # the second goes on there
        done = inprocess.run(words, env=environment(tmp_path), cwd=place)
        assert done.code == 0, done.err
    assert listing(place) == before
    assert sorted(path.name for path in place.parent.iterdir()) == ["reddit", "reddit-restored"]
    assert (place.with_name("reddit-restored") / "restored" / "reddit").is_dir()


def test_a_data_root_beside_downloads_is_no_part_of_them(above: Path, tmp_path: Path) -> None:
    """It is named, or there is another folder beside them."""
    copy = Path(shutil.copytree(above, tmp_path / "downloads"))
    env = {**environment(tmp_path), "KB_CONTACT": "me@example.org"}
    for words in (["--data", "mine"], []):
        done = inprocess.run(["reddit", "crawl", *words], env=env, cwd=copy)
        inside = "is inside the download" in done.said
        assert (done.code, inside) == (2, not words)
        assert inside or "REDDIT_CLIENT_ID is not set" in done.said
    (copy / "notes").mkdir()
    done = inprocess.run(["reddit", "crawl"], env=env, cwd=copy)
    assert "REDDIT_CLIENT_ID is not set" in done.said


@pytest.mark.parametrize("name", [*WRITING, *READING])
def test_a_data_root_that_is_not_there_is_named_and_not_made(
    name: str, typed: Any, tmp_path: Path
) -> None:
    (tmp_path / "nowhere2" / "raw").mkdir(parents=True)
    (tmp_path / "other" / "raw").mkdir(parents=True)
    place = tmp_path / "nowhere"
    done = typed(name, "--data", str(place))
    assert done.code == 2
    assert f"there is no data root {place}; did you mean --data {place}2?" in done.said
    assert not place.exists()


def test_load_names_a_data_root_that_is_not_there(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match=r"there is no data root .*nowhere"):
        kb.load(tmp_path / "nowhere")


def names_path(option: Any) -> bool:
    return any(word in (option.metavar or "") for word in ("DIR", "FILE", "FOLDER"))


def listing(folder: Path) -> dict[str, tuple[int, str]]:
    """Every file and folder with its last change and a digest."""
    return {
        str(path.relative_to(folder)): (
            path.stat().st_mtime_ns,
            hashlib.sha256(path.read_bytes()).hexdigest() if path.is_file() else "",
        )
        for path in (folder, *folder.rglob("*"))
    }
