"""Tests of the commands that every source has."""

from pathlib import Path

import pytest

from kb.cli.framework.exit_codes import run_to_exit_code
from kb.cli.framework.source_commands import app_of
from kb.core.sources import SOURCES
from tests.inprocess import Here


@pytest.mark.parametrize("source", SOURCES)
def test_formats_are_those_of_the_source(here: Here, tmp_path: Path, source: str) -> None:
    (tmp_path / "data").mkdir()
    at = ("--data", str(tmp_path / "data"))
    done = here(source, "export", "--format", "nonesuch", *at)
    assert done.code == 2
    assert all(name in done.said for name in SOURCES[source].formats), done.said


@pytest.mark.parametrize("source", SOURCES)
@pytest.mark.parametrize("step", ["filter", "export"])
def test_without_data_nothing_is_written(
    here: Here, tmp_path: Path, source: str, step: str
) -> None:
    root = tmp_path / "data"
    root.mkdir()
    assert here(source, step, "--data", str(root)).code in (1, 2)
    assert not [path for path in root.rglob("*") if path.is_file() and path.suffix == ".parquet"]


def test_a_source_without_own_commands_has_the_nouns_of_its_spec(
    capsys: pytest.CaptureFixture[str],
) -> None:
    app = app_of("reddit")
    assert run_to_exit_code(app, ["--help"]) == 0
    listed = capsys.readouterr().out
    for name in ("crawl", "filter", "export"):
        assert name in listed
    assert run_to_exit_code(app, ["crawl", "--help"]) == 0
    crawl = capsys.readouterr().out
    assert "--limit" in crawl
    assert "posts" in crawl
