"""`kb demo` and `kb sandbox`."""

import json
import os
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
import requests
from dotenv import dotenv_values

from kb.cli.commands import demo
from kb.cli.commands.demo import play
from kb.cli.framework.options import Options
from kb.core.context import Run
from kb.core.errors import UsageError
from kb.sandbox.world import World
from kb.store.state import demo_mark
from tests import processes
from tests.conftest import ROOT
from tests.sandbox.domains import written
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
    monkeypatch.setattr(demo, "_tiny_model", lambda missing: {})

    def begin(data: Path, **options: Any) -> list[Run]:
        play(Options(data=data, quiet=True, **options), **DEMO)
        return runs

    return begin


def test_a_demo_without_scores_is_released_and_says_so(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """As where torch is not installed."""
    monkeypatch.setattr(demo, "_tiny_model", lambda missing: {})
    sources = [f"{source} {step}" for source in ("wiki", "reddit") for step in STEPS]
    without = {*sources, "reddit import", "refresh reddit", "reddit reconstruct", "report"}
    done = play(Options(data=tmp_path, quiet=True), without, **DEMO)
    assert done["release"]["folders"] == 4
    card = (tmp_path / "demo/release/youtube/README.md").read_text()
    assert "Toxicity: not scored" in card
    assert "left_out" not in done["index"]
    assert "\nkb query " in capsys.readouterr().out


@pytest.mark.parametrize("finished", [True, False])
def test_a_demo_starts_over_after_a_finished_one_and_else_goes_on(
    tmp_path: Path, begun: Callable[..., list[Run]], finished: bool
) -> None:
    (tmp_path / "demo" / "clean" / "wiki").mkdir(parents=True)
    demo_mark.write_mark(tmp_path / "demo", finished=finished)
    begun(tmp_path)
    assert (tmp_path / "demo" / "clean").exists() == (not finished)
    assert demo_mark.read_mark(tmp_path / "demo") == demo_mark.DemoMark(finished=False)


def test_the_dumps_of_a_demo_are_not_in_its_data_root(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """In it they would hold what a purge removes everywhere else."""
    seen: list[Path] = []

    def import_dumps(*world: object) -> None:
        *_, given = world
        seen.extend(given["reddit import"]["files"])
        assert all(file.is_file() for file in seen)

    monkeypatch.setattr(demo, "_all", import_dumps)
    monkeypatch.setattr(demo, "_tiny_model", lambda missing: {})
    play(Options(data=tmp_path, quiet=True), **DEMO)
    assert seen
    assert not any(file.is_relative_to(tmp_path / "demo") for file in seen)
    assert [path.name for path in tmp_path.iterdir()] == ["demo"]


def test_data_that_no_demo_has_made_are_left_alone(
    tmp_path: Path, begun: Callable[..., list[Run]]
) -> None:
    """Nor are they called invented from then on."""
    (tmp_path / "demo" / "raw").mkdir(parents=True)
    with pytest.raises(UsageError, match="holds data that no demo has made"):
        begun(tmp_path)
    assert [path.name for path in (tmp_path / "demo").iterdir()] == ["raw"]


KB = [sys.executable, "-m", "kb", "sandbox", "--no-model"]


def sandbox(*words: str, cwd: Path = ROOT) -> subprocess.CompletedProcess[str]:
    """`kb sandbox WORDS`, finished."""
    return processes.run(["sandbox", "--no-model", *words], env=os.environ, cwd=cwd, timeout=60)


def settings(text: str) -> dict[str, str]:
    return dict(line.split("=", 1) for line in text.splitlines())


def test_it_prints_settings_closes_stdout_and_serves_until_sigterm() -> None:
    child = subprocess.Popen(KB, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    assert child.stdout
    assert child.stderr
    values = settings(child.stdout.read())  # returns because stdout is closed
    assert set(values) == {
        "YOUTUBE_API_KEY",
        "REDDIT_CLIENT_ID",
        "REDDIT_CLIENT_SECRET",
        "KB_CONTACT",
        "KB_YOUTUBE_ENDPOINT",
        "KB_YOUTUBE_WEB",
        "KB_REDDIT_ENDPOINT",
        "KB_WIKI_URL",
    }
    assert requests.get(values["KB_YOUTUBE_WEB"] + "/watch?v=x", timeout=10).status_code == 200
    child.send_signal(signal.SIGTERM)
    assert child.wait(30) == 0
    assert child.stderr.read() == ""


def test_a_command_gets_the_settings_and_its_exit_code_is_ours() -> None:
    script = (
        "import os, sys, urllib.request as u\n"
        "u.urlopen(os.environ['KB_YOUTUBE_WEB'] + '/watch?v=x', timeout=9)\n"
    )
    script += "print(os.environ['KB_DATA'])\nsys.exit(7)"
    done = sandbox("--data", "/tmp/some where", "--", sys.executable, "-c", script)
    assert (done.returncode, done.stdout) == (7, "/tmp/some where\n")
    killed = sandbox("--", "sh", "-c", "kill -KILL $$")
    assert killed.returncode == 128 + signal.SIGKILL
    absent = sandbox("--", "no-such-command")
    assert (absent.returncode, absent.stderr) == (2, "kb: no-such-command: no such command\n")


def test_a_command_can_not_publish_what_is_invented(tmp_path: Path) -> None:
    """To no real service: its token stays outside, one of `.env` too."""
    (tmp_path / ".env").write_text("ZENODO_TOKEN=that-of-a-person\nHF_TOKEN=hf_that_of_a_person\n")
    look = (
        "from kb.core.config.settings import load_settings as load; settings = load();"
        "print([settings.zenodo_token.get_secret_value(), settings.hf_token.get_secret_value()])"
    )
    own = {"ZENODO_TOKEN": "that-of-a-person", "HF_TOKEN": "hf_that_of_a_person"}
    words = ["sandbox", "--no-model", "--", sys.executable, "-c", look]
    for env in (os.environ, os.environ | own):
        done = processes.run(words, env=env, cwd=tmp_path, timeout=60)
        assert done.stdout == "['', '']\n", done.stderr


def test_it_is_this_kb_that_a_command_calls() -> None:
    done = subprocess.run(
        [*KB, "--", "kb", "--version"],
        capture_output=True,
        text=True,
        timeout=60,
        env={**os.environ, "PATH": "/usr/bin:/bin"},
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith("kb ")


def test_a_file_of_settings(tmp_path: Path) -> None:
    file = tmp_path / "my.env"
    done = sandbox("--env", str(file), "--", "true")
    assert done.returncode == 0
    assert settings(file.read_text())["KB_CONTACT"]
    assert "KB_DATA" not in settings(file.read_text())
    (tmp_path / "mine.toml").write_text(
        'name = "mine"\ntitle = "Mine"\n[reddit]\nsubreddit = "mine"\n'
    )
    given = ["--data", "my data", "--profile", "mine.toml"]
    done = sandbox(*given, "--env", str(file), "--", "true", cwd=tmp_path)
    assert done.returncode == 0
    said = dotenv_values(file)
    assert said["KB_DATA"] == str(tmp_path / "my data")
    assert said["KB_PROFILE"] == str(tmp_path / "mine.toml")


def test_the_world_is_the_profiles(tmp_path: Path) -> None:
    path = written("bread", tmp_path)
    look = (
        "import os, urllib.request as u; root = os.environ['KB_WIKI_URL'];"
        "print(u.urlopen(root + '/wiki/Main_Page').read().decode(), os.environ['KB_PROFILE'])"
    )
    words = ["--profile", str(path), "--", sys.executable, "-c", look]
    done = sandbox(*words)
    assert "Bread Baking Wiki" in done.stdout, done.stderr
    assert str(path) in done.stdout
    path.write_text(path.read_text().replace("[26, 10]", '["FILL-IN"]'))
    refused = sandbox(*words)
    assert (refused.returncode, refused.stdout) == (2, "")
    assert "kb profile check" in refused.stderr


def test_sigterm_reaches_the_command(tmp_path: Path) -> None:
    ready = tmp_path / "ready"
    script = (
        "import signal, sys; signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGTERM]);"
        f" open({str(ready)!r}, 'w').close(); signal.sigwait([signal.SIGTERM]); sys.exit(3)"
    )
    child = subprocess.Popen([*KB, "--", sys.executable, "-c", script])
    while not ready.exists() and child.poll() is None:
        pass
    child.send_signal(signal.SIGTERM)
    assert child.wait(60) == 3


def test_the_truth_of_the_world_is_written_as_json(tmp_path: Path) -> None:
    small = ("--seed", "3", "--videos", "60")
    done = sandbox("--truth", "truth.json", *small, "--", "true", cwd=tmp_path)
    assert (done.returncode, done.stderr) == (0, "")
    assert json.loads((tmp_path / "truth.json").read_text()) == World(3, n_videos=60).truth


def test_films_are_there_before_the_command_runs(tmp_path: Path) -> None:
    done = sandbox("--videos", "3", "--films", "films", "--", "ls", "films", cwd=tmp_path)
    assert (done.returncode, done.stderr) == (0, "")
    names = {f"{key}.mp4" for key in World(0, n_videos=3).youtube.videos}
    assert set(done.stdout.split()) == names
