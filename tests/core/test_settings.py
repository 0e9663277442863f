"""Settings: the environment wins over .env, and no secret is ever printed."""

from __future__ import annotations

import pytest

from kb.core.errors import MissingCredential, SettingError
from kb.core.settings import load_settings


@pytest.fixture(autouse=True)
def empty_place(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for name in ("YOUTUBE_API_KEY", "REDDIT_CLIENT_ID", "REDDIT_CLIENT_SECRET", "KB_CONTACT", "KB_NOW", "KB_WIKI_URL", "KB_DATA"):
        monkeypatch.delenv(name, raising=False)
    return tmp_path


def test_the_environment_wins_over_the_file(empty_place, monkeypatch):
    (empty_place / ".env").write_text("YOUTUBE_API_KEY=from-file\nKB_CONTACT=me@example.org\n")
    monkeypatch.setenv("YOUTUBE_API_KEY", "from-environment")
    settings = load_settings()
    assert (settings.need("youtube_api_key"), settings.kb_contact) == ("from-environment", "me@example.org")
    assert load_settings(dotenv=False).kb_contact is None


def test_secrets_do_not_print(monkeypatch):
    monkeypatch.setenv("YOUTUBE_API_KEY", "very-secret-value")
    settings = load_settings()
    assert "very-secret-value" not in f"{settings!r} {settings} {settings.model_dump()} {settings.model_dump_json()}"
    assert settings.secret_values() == ["very-secret-value"]


def test_a_missing_credential_says_which(monkeypatch):
    with pytest.raises(MissingCredential, match="YOUTUBE_API_KEY is not set") as error:
        load_settings().need("youtube_api_key")
    assert error.value.exit_code == 2


def test_an_empty_secret_is_an_installed_app_and_an_unset_one_is_missing(monkeypatch):
    with pytest.raises(MissingCredential):
        load_settings().need("reddit_client_secret")
    monkeypatch.setenv("REDDIT_CLIENT_SECRET", "")
    assert load_settings().need("reddit_client_secret") == ""


@pytest.mark.parametrize(("name", "value"), [("KB_WIKI_URL", "minecraft.wiki"), ("KB_WIKI_URL", "http://name:hunter2@host"), ("KB_NOW", "yesterday")])
def test_a_wrong_value_is_named(monkeypatch, name, value):
    monkeypatch.setenv(name, value)
    with pytest.raises(SettingError, match=name) as error:
        load_settings()
    assert "hunter2" not in str(error.value)


def test_a_build_date_beyond_the_calendar_is_a_wrong_setting(monkeypatch):
    monkeypatch.setenv("SOURCE_DATE_EPOCH", "99999999999999")
    with pytest.raises(SettingError, match="SOURCE_DATE_EPOCH"):
        load_settings()
