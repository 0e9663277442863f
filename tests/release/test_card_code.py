"""Every code block of every card, run in the folder of the card, on a downloaded release."""

import contextlib
import io
import re
import shlex
import subprocess
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import duckdb
import pytest

import kb
from kb.core.sources import PUBLISHED
from tests import inprocess
from tests.cli.conftest import clean_environment

SOURCES = ("youtube", "wiki", "reddit", "pairs", "tasks", "links")
_BLOCK = re.compile(r"^```(\w*)\n(.*?)^```", re.MULTILINE | re.DOTALL)
LANGUAGES = {"sh": 2, "python": 2, "sql": 2, "text": 1, "bibtex": 1}  # at least so many


@pytest.fixture(params=SOURCES)
def folder(
    downloads: Path, request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> Iterator[Path]:
    """A folder of the release, as the working folder; `../restored` was restored of it."""
    import datasets

    place: Path = downloads / "release" / request.param
    before = listing(place)
    monkeypatch.chdir(place)
    monkeypatch.setattr(datasets.config, "HF_DATASETS_CACHE", tmp_path)
    yield place
    assert listing(place) == before


def listing(place: Path) -> list[tuple[str, int]]:
    return sorted((path.name, path.stat().st_mtime_ns) for path in place.iterdir())


def blocks(folder: Path) -> list[tuple[str, str]]:
    text = (folder / "README.md").read_text(encoding="utf-8")
    found = _BLOCK.findall(text)
    assert text.count("\n```") == 2 * len(found)
    return found


def test_every_block_shows_rows(folder: Path) -> None:
    found = blocks(folder)
    counts = dict.fromkeys(LANGUAGES, 0)
    for language, code in found:
        counts[language] += 1
        if language == "python":
            check_python(code, folder)
        elif language == "sh":
            check_commands(code, folder)
        elif language == "sql":
            check_queries(code, folder)
    assert all(counts[name] >= least - (name == "sh") for name, least in LANGUAGES.items())


def check_python(code: str, folder: Path) -> None:
    """What each `print` was given has rows, or is one; all of it is shown."""
    printed: list[Any] = []
    with contextlib.redirect_stdout(io.StringIO()) as shown:

        def print_and_keep(*values: Any) -> None:
            printed.extend(values)
            print(*values)

        exec(code, {"print": print_and_keep})
    assert printed, code
    for value in printed:
        assert not hasattr(value, "__len__") or len(value), code
        assert str(value).splitlines()[0] in shown.getvalue()
    if PUBLISHED[folder.name].query in code:
        row = kb.load(".").sql(PUBLISHED[folder.name].query)[0]
        first = str(next(iter(row.values())))
        assert first in shown.getvalue()


def check_commands(code: str, folder: Path) -> None:
    for line in code.splitlines():
        words = shlex.split(line, comments=True)
        if not words:
            continue
        if words[0] == "kb":
            done = inprocess.run(words[1:], env=clean_environment(), cwd=folder)
            assert done.code == 0, done.err
            out = done.out
        else:
            out = subprocess.run(words, check=True, capture_output=True, text=True).stdout
        assert len(out.splitlines()) > 2 * (words[:2] == ["kb", "query"]), line


def check_queries(code: str, folder: Path) -> None:
    """A query names the folder's files, or tables of this and other folders."""
    for query in re.sub(r"--.*", "", code).strip().removesuffix(";").split(";\n"):
        if "read_parquet" in query:
            ((rows,),) = duckdb.sql(query.rstrip().removesuffix(";")).fetchall()
            assert rows
        else:
            assert len(kb.load("..").sql(query)), query
