"""Exit codes, and the line on stderr that goes with them."""

import errno
import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from kb.cli import main
from kb.cli.framework.command import command, group
from kb.cli.framework.exit_codes import run_to_exit_code
from kb.cli.framework.messages import set_options, with_options
from kb.cli.framework.options import Options
from kb.core import errors
from tests.cli.conftest import clean_environment


def classes(base: type[errors.KbError]) -> list[type[errors.KbError]]:
    return [base, *(inner for child in base.__subclasses__() for inner in classes(child))]


@pytest.fixture
def end(capsys: pytest.CaptureFixture[str]) -> Any:
    """end(error, json=True) -> (exit code, stdout, stderr) of a command that raises it."""

    def run(error: BaseException, **options: Any) -> tuple[int, str, str]:
        app = group("Test.")

        @command(app, raw=True, examples=[])
        def fail(given: Options) -> None:
            raise error

        code = run_to_exit_code(app, ["fail", *(f"--{name}" for name in options if options[name])])
        return (code, *capsys.readouterr())

    return run


@pytest.mark.parametrize(
    "kind", [kind for kind in classes(errors.KbError) if not issubclass(kind, errors.ItemError)]
)
def test_every_error_is_one_line_with_its_code(end: Any, kind: type[errors.KbError]) -> None:
    code, out, err = end(kind("what went wrong", hint="what to do"))
    codes = {errors.UsageError: 2, errors.ActionNeeded: 4, errors.Stopped: 3}
    assert code == next((code for base, code in codes.items() if issubclass(kind, base)), 1)
    assert err == "kb: what went wrong; what to do\n"
    assert out == ""


def test_a_stop_shows_what_was_done(end: Any) -> None:
    error = errors.LimitReached("--limit 5 reached")
    error.summary = {"crawled": 5, "kept": 4, "rejected": 1}
    code, out, _ = end(error)
    assert (code, out) == (3, "5 crawled, 4 kept, 1 rejected, stopped: --limit 5 reached\n")
    code, out, _ = end(error, json=True)
    assert json.loads(out) == {
        "crawled": 5,
        "kept": 4,
        "rejected": 1,
        "stopped": "--limit 5 reached",
        "waits_for": "next run",
    }


@pytest.mark.parametrize(
    ("error", "code", "words"),
    [
        (KeyboardInterrupt(), 3, "run the same command to resume"),
        (
            OSError(errno.ENOSPC, "No space left on device", "/data/x"),
            4,
            "no space left to write /data/x",
        ),
        (
            PermissionError(errno.EACCES, "Permission denied", "/data/y"),
            1,
            "/data/y: Permission denied",
        ),
        (
            ZeroDivisionError("division by zero"),
            1,
            "unexpected ZeroDivisionError: division by zero; run it again with --debug",
        ),
    ],
)
def test_errors_of_the_machine_and_our_own_mistakes(
    end: Any, error: BaseException, code: int, words: str
) -> None:
    got, out, err = end(error)
    assert got == code
    assert words in err
    assert err.count("\n") == 1
    assert "Traceback" not in err
    assert out == ""


def test_debug_shows_the_traceback(end: Any) -> None:
    _, _, err = end(ZeroDivisionError("division by zero"), debug=True)
    assert "Traceback (most recent call last)" in err


def test_a_message_of_several_lines_becomes_one(end: Any) -> None:
    _, _, err = end(errors.FatalError("first\n   second"))
    assert err == "kb: first second\n"


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["yuotube", "crawl"], ["`kb yuotube crawl`", "`kb youtube crawl`", "kb --help"]),
        (["youtube", "crwal"], ["`kb youtube crwal`", "`kb youtube crawl`", "kb youtube --help"]),
        (
            ["youtube"],
            ["Missing command: one of crawl, import, filter, export", "kb youtube --help"],
        ),
        (["youtube", "crawl", "--limt", "3"], ["--limt", "--limit", "kb youtube crawl --help"]),
        (["youtube", "crawl", "--limit", "0"], ["--limit", "1"]),
        (["youtube", "crawl", "--limit", "many"], ["--limit"]),
        (["youtube", "crawl", "--only", "chanels"], ["--only", "chanels", "channels"]),
        (["youtube", "crawl", "--part", "5/4"], ["--part", "5/4", "1/4"]),
        (["youtube", "crawl", "--part", "²/4"], ["--part", "²/4", "1/4"]),
        (["youtube", "crawl", "--part", f"1/{'9' * 5000}"], ["--part", "1/4"]),
        (["pairs", "--engine", "ray"], ["--engine", "'ray'", "dask"]),
        (["pairs", "--scheduler", "tcp://127.0.0.1:1"], ["--scheduler", "--engine dask"]),
        (["status", "--profile", "minecarft"], ["minecarft", "minecraft"]),
        (["status", "--profile", "nowhere.toml"], ["nowhere.toml"]),
        (["query"], ["--tables"]),
        (["query", "--tables", "FROM x"], ["--tables"]),
    ],
)
def test_wrong_usage_is_exit_2_with_a_guess_and_writes_nothing(
    kb: Any, tmp_path: Path, arguments: list[str], words: list[str]
) -> None:
    answer = kb(*arguments)
    assert answer.returncode == 2, answer.stderr
    assert answer.stdout == ""
    assert answer.stderr.count("\n") == 1, answer.stderr
    assert answer.stderr.startswith("kb: ")
    for word in words:
        assert word in answer.stderr
    assert list(tmp_path.iterdir()) == []


def test_a_reader_that_leaves_early_is_no_failure(tmp_path: Path) -> None:
    """`kb query … | head -1`."""
    reading, writing = os.pipe()
    os.close(reading)
    done = subprocess.run(
        [sys.executable, "-m", "kb", "query", "SELECT * FROM range(1000000)", "--format", "csv"],
        cwd=tmp_path,
        env=clean_environment(),
        stdout=writing,
        stderr=subprocess.PIPE,
        text=True,
        check=False,
    )
    os.close(writing)
    assert (done.returncode, done.stderr) == (0, "")


@pytest.mark.parametrize(
    "words",
    [
        ("youtube", "crawl", "--plan", "--ids"),
        ("wiki", "crawl", "--plan", "--titles"),
        ("purge", "youtube", "--plan", "--ids"),
        ("purge", "wiki", "--plan", "--ids"),
        ("purge", "reddit", "--plan", "--ids"),
    ],
    ids=" ".join,
)
def test_a_file_of_ids_nested_without_end_is_wrong_usage(
    here: Any, tmp_path: Path, words: tuple[str, ...]
) -> None:
    (tmp_path / "data").mkdir()
    deep = tmp_path / "deep.json"
    deep.write_text('{"a":' * 100_000)
    done = here(*words, str(deep), "--data", str(tmp_path / "data"))
    assert done.code == 2, done.err
    assert str(deep) in done.said
    assert "unexpected" not in done.err


def test_an_option_of_a_sibling_is_looked_for_there_first(kb: Any) -> None:
    answer = kb("youtube", "export", "--limit", "3", "--wait", "--again")
    assert answer.returncode == 2
    assert "`kb youtube export` has no --limit" in answer.stderr
    assert "of `kb youtube crawl`, `kb youtube import` and" in answer.stderr
    answer = kb("youtube", "crawl", "--titles", "x")
    assert "`kb youtube crawl` has no --titles; it is an option of `kb wiki crawl`" in answer.stderr


EACH = "`kb youtube {0}`, `kb wiki {0}` or `kb reddit {0}`"
ALL = "`kb youtube export`, `kb wiki export`, `kb reddit export`"


@pytest.mark.parametrize(
    ("line", "meant"),
    [
        ("export", f"{ALL} or 1 more"),
        ("filter", EACH.format("filter")),
        ("crawl", EACH.format("crawl")),
        ("exprot", f"{ALL} or 1 more"),
        ("crawl youtube", "`kb youtube crawl`"),
        ("crawl wiki --limit 3", "`kb wiki crawl`"),
        ("youtube crwal", "`kb youtube crawl`"),
        ("yuotube crawl --plan", "`kb youtube crawl`"),
        ("youtube-crawl", "`kb youtube crawl`"),
        ("pairs keyword", "`kb pairs keywords`"),
        ("publish", "`kb release publish`"),
        ("serach wolf", "`kb search`"),
    ],
)
def test_a_command_in_the_wrong_place_is_answered_with_the_right_one(
    line: str, meant: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as ended:
        main(line.split())
    assert ended.value.code == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1
    assert said.startswith("kb: there is no command `kb ")
    assert f"; did you mean {meant}?; see `kb " in said


def test_a_word_that_is_like_no_command_gets_no_guess(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        main(["zzzz"])
    assert ended.value.code == 2
    assert capsys.readouterr().err == "kb: there is no command `kb zzzz`; see `kb --help`\n"


@pytest.mark.parametrize(
    ("text", "wanted"),
    [
        ("run `kb youtube filter` first", "run `kb youtube filter --data 'my data' --profile x`"),
        ("`kb query --tables` lists", "`kb query --tables --data 'my data' --profile x` lists"),
        ("run `kb pairs --data y`", "run `kb pairs --data y --profile x`"),
        ("run `kb models fetch`", "run `kb models fetch --profile x`"),
        ("see `kb youtube crawl --help`", "see `kb youtube crawl --help`"),
        ("`kb demo` shows it", "`kb demo` shows it"),
        ("run `pip install x`", "run `pip install x`"),
    ],
)
def test_a_named_command_is_completed_with_what_this_call_was_given(text: str, wanted: str) -> None:
    set_options(Path("my data"), "x")
    try:
        assert wanted in with_options(text)
    finally:
        set_options()
    assert with_options(text) == text


def test_an_address_that_a_hint_repeats_is_whole() -> None:
    set_options(Path("s3://bucket/release"))
    try:
        assert "--data s3://bucket/release`" in with_options("`kb query`")
    finally:
        set_options()
