"""Memory that runs out: one line, whichever library met it, and nothing is called damaged."""

import errno
import os
import resource
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import duckdb
import pyarrow as pa
import pytest

from kb.cli.framework.exit_codes import describe
from kb.core.errors import DamagedData
from kb.sandbox.toxicity import tiny_checkpoint
from kb.store.damage import opening
from tests.cli.conftest import clean_environment
from tests.conftest import ROOT
from tests.filters import full_root

MB = 1 << 20


def python() -> None:
    bytearray(1 << 60)


def arrow() -> None:
    pa.allocate_buffer(1 << 60)


def engine() -> None:
    with duckdb.connect(config={"memory_limit": "1MB", "temp_directory": ""}) as con:
        con.sql("SELECT list(i) FROM range(10_000_000) AS r(i)").fetchall()


def system() -> None:
    raise OSError(errno.ENOMEM, os.strerror(errno.ENOMEM), "a/file")


@pytest.mark.parametrize("use", [python, arrow, engine, system])
def test_it_is_one_line_and_no_damage(use: Callable[[], None]) -> None:
    with (
        pytest.raises(Exception) as told,  # noqa: PT011  of any class
        opening("a file", pa.ArrowException, duckdb.Error),
    ):
        use()
    assert not isinstance(told.value, DamagedData)
    assert describe(told.value) == ("out of memory", "try fewer --workers", 1)


@pytest.mark.parametrize(
    "error",
    [
        DamagedData("a title that says out of memory"),
        ValueError("out of memory"),
        duckdb.ConversionException("Could not convert string 'out of memory' to INT32"),
        OSError(errno.EIO, "out of memory", "a/file"),
    ],
    ids=lambda error: type(error).__name__,
)
def test_what_only_quotes_the_words_is_something_else(error: Exception) -> None:
    assert "out of memory;" not in describe(error)[0]
    assert describe(error)[1] != "try fewer --workers"


@pytest.fixture(scope="module")
def root(tmp_path_factory: pytest.TempPathFactory) -> Path:
    made = tmp_path_factory.mktemp("memory") / "data"
    full_root.make(made)
    return made


@pytest.mark.skipif(sys.platform != "linux", reason="elsewhere the limit is not kept")
@pytest.mark.parametrize("limit", [400, 700, 780])
@pytest.mark.parametrize("command", ["verify", "query", "youtube filter"])
def test_a_command_with_little_memory_says_so(root: Path, command: str, limit: int) -> None:
    words = {"query": ("query", "SELECT max(title), count(*) FROM youtube_videos")}
    before = {path: path.read_bytes() for path in root.glob("raw/**/*.zst")}
    done = subprocess.run(
        [sys.executable, "-m", "kb", *words.get(command, command.split()), "--data", str(root)],
        env={
            **clean_environment(),
            "PYTHONPATH": str(ROOT),
            "KB_TOXICITY_MODEL": str(tiny_checkpoint()),
        },
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_AS, (limit * MB, limit * MB)),
        capture_output=True,
        text=True,
        check=False,
    )
    if done.returncode == 1:
        assert "Traceback" not in done.stderr
        assert "damaged" not in done.stderr
    else:  # a library may end the process itself, or not load at all
        assert done.returncode in (0, 2, 127, 134) or done.returncode < 0, done
    assert before == {path: path.read_bytes() for path in root.glob("raw/**/*.zst")}
