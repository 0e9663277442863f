"""Settings, profile and data root are checked before anything is written."""

import shutil
from pathlib import Path
from typing import Any

import pytest

from kb.cli.framework.exit_codes import run_to_exit_code
from kb.cli.framework.options import in_demo_root
from kb.cli.framework.source_commands import app_of
from kb.core.config.profile import load_profile
from kb.core.config.settings import load_settings
from kb.core.errors import MissingExtra
from kb.core.installation import folder
from kb.core.sources import SOURCES
from kb.sandbox import toxicity
from kb.store.state import demo_mark
from tests.inprocess import Here


def test_a_wrong_setting_names_itself_and_not_its_value(kb: Any) -> None:
    answer = kb("status", env={"KB_YOUTUBE_ENDPOINT": "http://user:hunter2@127.0.0.1:1"})
    assert answer.returncode == 2
    assert "KB_YOUTUBE_ENDPOINT" in answer.stderr
    assert "hunter2" not in answer.stderr + answer.stdout


@pytest.mark.parametrize(
    "env",
    [
        {"KB_YOUTUBE_ENDPOINT": "http://127.0.0.1:99999"},
        {"KB_YOUTUBE_ENDPOINT": "http://127.0.0.1:8 0"},
        {"KB_CONTACT": "a\nb@example.org"},
        {"KB_CONTACT": "snow☃man@example.org"},
    ],
)
def test_a_wrong_setting_is_found_before_anything_is_written(
    kb: Any, tmp_path: Path, env: dict[str, str]
) -> None:
    web = "http://127.0.0.1:9"
    answer = kb(
        "youtube",
        "crawl",
        env={"YOUTUBE_API_KEY": "k", "KB_YOUTUBE_ENDPOINT": web, "KB_YOUTUBE_WEB": web} | env,
    )
    assert answer.returncode == 2, answer.stderr
    assert answer.stderr.count("\n") == 1
    assert next(name for name in env) in answer.stderr
    assert list(tmp_path.iterdir()) == []


def test_a_name_that_is_no_setting_is_a_warning(kb: Any, tmp_path: Path) -> None:
    (tmp_path / ".env").write_text("YOUTUBE_APIKEY=hunter2\n")
    answer = kb("status", "--quiet")
    assert answer.returncode == 0
    assert answer.stderr == (
        "warning: YOUTUBE_APIKEY in .env is not a setting and has no effect;"
        " did you mean YOUTUBE_API_KEY?\n"
    )
    assert kb("query", "SELECT 1 AS n", "--json").stdout == '[{"n":1}]\n'


@pytest.mark.parametrize("source", ["youtube", "wiki", "reddit"])
def test_a_contact_that_is_none_is_found_before_anything_is_written(
    kb: Any, tmp_path: Path, source: str
) -> None:
    keys = dict.fromkeys(("YOUTUBE_API_KEY", "REDDIT_CLIENT_ID", "REDDIT_CLIENT_SECRET"), "hunter2")
    answer = kb(source, "crawl", env={**keys, "KB_CONTACT": "me"})
    assert answer.returncode == 2
    assert answer.stderr.startswith('kb: KB_CONTACT is "me": must contain an e-mail or web')
    assert list(tmp_path.iterdir()) == []


def test_empty_settings_change_nothing(kb: Any, tmp_path: Path) -> None:
    plain = kb("status")
    assert (
        kb(
            "status",
            env={"KB_DATA": "", "KB_PROFILE": "", "KB_TOXICITY_MODEL": "", "KB_CONTACT": ""},
        ).stdout
        == plain.stdout
    )
    assert str(tmp_path / "data") in plain.stdout


@pytest.mark.parametrize(
    ("arguments", "code"),
    [
        (["purge", "youtube"], 2),
        (["purge", "wiki", "--ids", "gone.txt"], 2),
        (["refresh", "youtube"], 2),
        (["report"], 2),
        (["youtube", "filter", "--profile", "off.toml"], 2),
        (["youtube", "export"], 2),
        (["release"], 2),
        (["pairs"], 2),
        (["query", "FROM youtube_videos"], 2),
        (["query", "--tables"], 2),
        (["status"], 2),
    ],
)
def test_a_data_root_that_is_not_there_is_not_made(
    kb: Any, tmp_path: Path, arguments: list[str], code: int
) -> None:
    shipped = folder("profiles") / "minecraft"
    shutil.copytree(shipped, tmp_path / "profile")
    text = (
        (shipped / "profile.toml")
        .read_text(encoding="utf-8")
        .replace('toxicity = "on"', 'toxicity = "off"')
    )
    (tmp_path / "profile" / "off.toml").write_text(text, encoding="utf-8")
    arguments = ["profile/off.toml" if word == "off.toml" else word for word in arguments]
    answer = kb(*arguments, "--data", "mistyped", env={"YOUTUBE_API_KEY": "k"})
    assert answer.returncode == code, answer.stderr
    assert not (tmp_path / "mistyped").exists()
    assert answer.stderr.count("\n") == 1, answer.stderr


def test_a_file_as_data_root_is_refused(kb: Any, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    answer = kb("status", "--data", "file")
    assert answer.returncode == 2
    assert "not a folder" in answer.stderr


def test_a_demos_root_keeps_its_model(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("KB_TOXICITY_MODEL", raising=False)
    profile, plain = load_profile("minecraft"), load_settings(dotenv=False)
    assert in_demo_root(tmp_path, plain, profile) == (plain, profile)
    demo_mark.write_mark(tmp_path, finished=True)
    monkeypatch.setattr(toxicity, "tiny_checkpoint", lambda: Path("tiny.ckpt"))
    settings, same = in_demo_root(tmp_path, plain, profile)
    assert settings.kb_toxicity_model == "tiny.ckpt"
    assert same is profile
    named = load_settings(dotenv=False, kb_toxicity_model="original")
    assert in_demo_root(tmp_path, named, profile) == (named, profile)


def test_a_demo_without_the_model_is_not_scored(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def missing() -> Path:
        raise MissingExtra("torch is not installed")

    monkeypatch.delenv("KB_TOXICITY_MODEL", raising=False)
    monkeypatch.setattr(toxicity, "tiny_checkpoint", missing)
    demo_mark.write_mark(tmp_path, finished=True)
    _, profile = in_demo_root(tmp_path, load_settings(dotenv=False), load_profile("minecraft"))
    assert profile.toxicity.toxicity == "off"


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
