"""Tests of `kb demo`."""

import os
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from kb.cli.commands import demo
from kb.cli.commands.demo import play
from kb.cli.framework.options import Options
from kb.core.context import Run
from kb.core.errors import UsageError
from kb.store.state import demo_mark
from tests.small_worlds import DEMO

STEPS = ("crawl", "filter", "export")


@pytest.fixture(autouse=True)
def _environment() -> Iterator[None]:
    """A demo removes settings and makes its own."""
    before = dict(os.environ)
    yield
    os.environ.clear()
    os.environ.update(before)


@pytest.mark.parametrize(("asked", "workers"), [(None, 1), (3, 3)])
def test_a_demo_is_done_by_one_process_unless_more_are_asked_for(
    tmp_path: Path, begun: Callable[..., list[Run]], asked: int | None, workers: int
) -> None:
    """Its world is done before others have imported what they need."""
    (run,) = begun(tmp_path, workers=asked)
    assert run.workers == workers


@pytest.fixture
def begun(monkeypatch: pytest.MonkeyPatch) -> Callable[..., list[Run]]:
    """begun(folder, …) → the Run of a demo there, of which no step is done."""
    runs: list[Run] = []
    monkeypatch.setattr(demo, "_all", lambda steps, queries, words, run, *rest: runs.append(run))
    monkeypatch.setattr(demo, "_model", lambda options: {})

    def begin(data: Path, **options: Any) -> list[Run]:
        play(Options(data=data, quiet=True, **options), **DEMO)
        return runs

    return begin


def test_a_demo_without_scores_is_released_and_says_so(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """As where torch is not installed."""
    monkeypatch.setattr(demo, "_model", lambda options: {})
    sources = [f"{source} {step}" for source in ("wiki", "reddit") for step in STEPS]
    without = {*sources, "reddit import", "refresh reddit", "reddit reconstruct", "report"}
    done = play(Options(data=tmp_path, quiet=True), without, **DEMO)
    assert done["release"]["folders"] == 3
    card = (tmp_path / "demo/release/youtube/README.md").read_text()
    assert "Toxicity: not scored" in card
    assert "left_out" not in done["index"]
    assert "\nkb query " in capsys.readouterr().out


@pytest.mark.parametrize("finished", [True, False])
def test_a_demo_starts_over_after_a_finished_one_and_else_goes_on(
    tmp_path: Path, begun: Callable[..., list[Run]], finished: bool
) -> None:
    (tmp_path / "demo" / "clean" / "wiki").mkdir(parents=True)
    demo_mark.write(tmp_path / "demo", finished=finished)
    begun(tmp_path)
    assert (tmp_path / "demo" / "clean").exists() == (not finished)
    assert demo_mark.read(tmp_path / "demo") == demo_mark.DemoMark(finished=False)


def test_a_finished_demo_of_an_older_version_is_one(
    tmp_path: Path, begun: Callable[..., list[Run]]
) -> None:
    (tmp_path / "demo" / "clean").mkdir(parents=True)
    (tmp_path / "demo" / demo_mark.OLDER).touch()
    assert demo_mark.note(tmp_path / "demo")
    begun(tmp_path)
    assert {path.name for path in (tmp_path / "demo").iterdir()} == {"dumps", demo_mark.NAME}


def test_data_that_no_demo_has_made_are_left_alone(
    tmp_path: Path, begun: Callable[..., list[Run]]
) -> None:
    """Nor are they called invented from then on."""
    (tmp_path / "demo" / "raw").mkdir(parents=True)
    with pytest.raises(UsageError, match="holds data that no demo has made"):
        begun(tmp_path)
    assert [path.name for path in (tmp_path / "demo").iterdir()] == ["raw"]
