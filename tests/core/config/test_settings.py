"""Settings: the environment wins over .env, and no secret is ever printed."""

import pytest

from kb.core.config.settings import REDDIT, Settings, load_settings, unknown_names
from kb.core.errors import MissingCredential, SettingError
from kb.net.session import HttpSession


def test_the_environment_wins_over_the_file(empty_place, monkeypatch):
    (empty_place / ".env").write_text(
        "YOUTUBE_API_KEY=from-file\nKB_CONTACT=me@example.org\n",
        encoding="utf-8-sig",
        newline="\r\n",
    )
    monkeypatch.setenv("YOUTUBE_API_KEY", "from-environment")
    settings = load_settings()
    assert (settings.need("youtube_api_key"), settings.kb_contact) == (
        "from-environment",
        "me@example.org",
    )
    assert load_settings(dotenv=False).kb_contact is None


def test_secrets_do_not_print(monkeypatch):
    monkeypatch.setenv("YOUTUBE_API_KEY", "very-secret-value")
    settings = load_settings()
    assert (
        "very-secret-value"
        not in f"{settings!r} {settings} {settings.model_dump()} {settings.model_dump_json()}"
    )
    assert settings.secret_values() == ["very-secret-value"]


def test_a_missing_credential_says_which(monkeypatch):
    with pytest.raises(MissingCredential, match="YOUTUBE_API_KEY is not set") as error:
        load_settings().need("youtube_api_key")
    assert error.value.exit_code == 2


def test_a_secret_too_short_to_be_hidden_is_warned_about(monkeypatch, caplog):
    monkeypatch.setenv("YOUTUBE_API_KEY", "abc")
    monkeypatch.setenv("ZENODO_TOKEN", "abcdefgh")
    settings = load_settings()
    assert (settings.need("youtube_api_key"), settings.need("zenodo_token")) == ("abc", "abcdefgh")
    assert settings.need("youtube_api_key") == "abc"
    (record,) = caplog.records  # once
    assert record.getMessage().startswith("YOUTUBE_API_KEY has fewer than 8 characters")
    assert "abc" not in record.getMessage()


def test_all_that_is_missing_is_named_at_once(monkeypatch):
    monkeypatch.setenv("REDDIT_CLIENT_ID", "mine")
    with pytest.raises(MissingCredential) as error:
        load_settings().require("youtube_api_key", *REDDIT)
    missing = (
        "YOUTUBE_API_KEY is not set (",
        "REDDIT_CLIENT_SECRET is not set (",
        "KB_CONTACT is not",
    )
    assert all(name in str(error.value) for name in missing)
    assert "REDDIT_CLIENT_ID" not in str(error.value)
    assert "\n" not in str(error.value)


def test_all_wrong_settings_are_named_at_once(monkeypatch):
    monkeypatch.setenv("KB_WIKI_URL", "minecraft.wiki")
    monkeypatch.setenv("KB_NOW", "tomorrow")
    with pytest.raises(SettingError) as error:
        load_settings()
    assert "KB_WIKI_URL" in str(error.value)
    assert "KB_NOW" in str(error.value)


def test_an_empty_secret_is_an_installed_app_and_an_unset_one_is_missing(monkeypatch):
    with pytest.raises(MissingCredential):
        load_settings().need("reddit_client_secret")
    monkeypatch.setenv("REDDIT_CLIENT_SECRET", "")
    assert load_settings().need("reddit_client_secret") == ""


ROOTS = (
    "KB_YOUTUBE_ENDPOINT",
    "KB_YOUTUBE_WEB",
    "KB_REDDIT_ENDPOINT",
    "KB_WIKI_URL",
    "KB_ZENODO_ENDPOINT",
    "KB_MODELS_ENDPOINT",
)
NO_ROOTS = [
    "minecraft.wiki",
    "ftp://host",
    "http://",
    "http://[::1",
    "http://a..b",
    "http://name:hunter2@host",
    "http://hunter2@host",
    "http://127.0.0.1:99999",
    "http://127.0.0.1:0",
    "http://127.0.0.1:-1",
    "http://127.0.0.1:8 0",
    "http://127.0.0.1:8\t0",
    "http://127.0.0.1:80/?a=b",
    "http://127.0.0.1:80/?",
    "http://127.0.0.1:80/#top",
    "http://example.org",
    "http://10.0.0.1:8000",
    "http://127.0.0.1.example.org",
]


@pytest.mark.parametrize(
    ("name", "value"),
    [
        *((ROOTS[number % len(ROOTS)], value) for number, value in enumerate(NO_ROOTS)),
        ("KB_NOW", "yesterday"),
        ("KB_NOW", "0001-01-01T00:00:00+10:00"),
        ("SOURCE_DATE_EPOCH", "-1"),
        ("SOURCE_DATE_EPOCH", "99999999999999"),
        ("SOURCE_DATE_EPOCH", "99999999999999999999"),
        ("KB_CONTACT", "a\nb@example.org"),
        ("KB_CONTACT", "snow☃man@example.org"),
        ("ZENODO_TOKEN", "hunter2\nhunter2"),
        ("YOUTUBE_API_KEY", "hunter2☃"),
        ("KB_DATA", "da\nta"),
    ],
)
def test_a_wrong_value_is_named_and_not_shown(monkeypatch, name, value):
    monkeypatch.setenv(name, value)
    with pytest.raises(SettingError, match=name) as error:
        load_settings()
    assert error.value.exit_code == 2
    assert "hunter2" not in str(error.value)


@pytest.mark.parametrize("name", ROOTS)
@pytest.mark.parametrize(
    ("value", "root"),
    [
        ("http://127.0.0.1:8000/", "http://127.0.0.1:8000"),
        (" https://[::1]/mirror/yt ", "https://[::1]/mirror/yt"),
        ("https://bücher.example", None),
    ],
)
def test_a_root_is_taken_without_its_last_slash(monkeypatch, name, value, root):
    monkeypatch.setenv(name, value)
    assert getattr(load_settings(), name.lower()) == (root or value)


@pytest.mark.parametrize("empty", ["", "   "])
def test_an_empty_value_is_no_value(empty_place, monkeypatch, empty):
    secrets = {"youtube_api_key", "reddit_client_id", "reddit_client_secret"}
    secrets |= {"zenodo_token", "hf_token"}
    unset = load_settings(dotenv=False)
    for name in set(Settings.model_fields) - secrets:
        monkeypatch.setenv(name.upper(), empty)
    assert load_settings() == unset
    # In the file as well; and the environment wins, also with nothing.
    (empty_place / ".env").write_text(
        "".join(
            f"{name.upper()}={empty}\n" for name in Settings.model_fields if name not in secrets
        )
    )
    for name in Settings.model_fields:
        monkeypatch.delenv(name.upper(), raising=False)
    assert load_settings() == unset
    (empty_place / ".env").write_text("KB_DATA=elsewhere\n")
    monkeypatch.setenv("KB_DATA", empty)
    assert load_settings().kb_data == unset.kb_data
    for name in ("youtube_api_key", "reddit_client_id", "zenodo_token", "kb_contact"):
        monkeypatch.setenv(name.upper(), empty)
        with pytest.raises(MissingCredential, match=name.upper()):
            load_settings().need(name)


def test_spaces_around_a_value_are_none_of_it(monkeypatch):
    monkeypatch.setenv("KB_CONTACT", " me@example.org ")
    monkeypatch.setenv("YOUTUBE_API_KEY", "key\n")
    assert (load_settings().kb_contact, load_settings().need("youtube_api_key")) == (
        "me@example.org",
        "key",
    )


def test_a_file_that_is_no_text_is_said_to_be_none(empty_place):
    (empty_place / ".env").write_bytes(b"KB_CONTACT=J\xf6rg\n")
    with pytest.raises(SettingError, match=r"\.env can't be read: not UTF-8 text \(byte 13\)"):
        load_settings()
    assert load_settings(dotenv=False).kb_contact is None


@pytest.mark.parametrize(
    ("name", "value", "message"),
    [
        ("SOURCE_DATE_EPOCH", "soon", 'is "soon": '),
        ("SOURCE_DATE_EPOCH", "1.5", 'is "1.5": Input'),
        ("SOURCE_DATE_EPOCH", "-1", 'is "-1": Input should be greater'),
        ("SOURCE_DATE_EPOCH", "9" * 30, "or equal to 253402300799"),
        ("SOURCE_DATE_EPOCH", "9" * 5000, "…: Unable to parse"),
        (
            "KB_NOW",
            "yesterday",
            'is "yesterday": must be a date and time: 2026-11-20T12:00:00Z',
        ),
        ("KB_NOW", "0001-01-01T00:00:00+10:00", "must be a time from the years 1970 to 2200"),
        ("KB_DATA", "da\nta", 'is "da\\nta": must not contain line breaks'),
        ("KB_CONTACT", "snow☃man@example.org", "must consist of Latin letters, digits and signs"),
        (
            "KB_WIKI_URL",
            "minecraft.wiki",
            "KB_WIKI_URL: must be an address like http://127.0.0.1:8000",
        ),
        (
            "KB_WIKI_URL",
            "http://hunter2@host",
            "KB_WIKI_URL: must not contain a user name or password",
        ),
        ("ZENODO_TOKEN", "hunter2\nhunter2", "ZENODO_TOKEN: must not contain line breaks"),
        ("YOUTUBE_API_KEY", "hunter2☃", "YOUTUBE_API_KEY: must consist of Latin letters"),
    ],
)
def test_what_is_wrong_is_said_in_a_users_words(monkeypatch, name, value, message):
    monkeypatch.setenv(name, value)
    with pytest.raises(SettingError) as error:
        load_settings()
    said = str(error.value)
    assert said.startswith(name)
    assert message in said
    assert len(said) < 300
    for word in ("hunter2", "isoformat"):
        assert word not in said.lower()


@pytest.mark.parametrize(
    ("contact", "good"),
    [
        ("me@example.org", True),
        ("https://example.org", True),
        ("http://example.org/about?x=1", True),
        ("www.example.org/bot", True),
        ("Jane Doe <jane@example.org>", True),
        ("the garden project, https://garden.example/", True),
        ("me", False),
        ("me@home", False),
        ("u/somebody", False),
        ("@somebody", False),
        ("https://", False),
        ("example", False),
        ("+49 30 1234567", False),
    ],
)
def test_a_contact_is_a_mail_or_web_address_where_it_is_needed(monkeypatch, contact, good):
    monkeypatch.setenv("KB_CONTACT", contact)
    settings = load_settings()  # a command that sends nothing does not mind
    if good:
        assert settings.need("kb_contact") == contact
        return
    for use in (lambda: settings.need("kb_contact"), lambda: HttpSession(settings)):
        with pytest.raises(SettingError, match=r"KB_CONTACT is .*e-mail or web address") as error:
            use()
        assert "me@example.org" in error.value.hint
        assert error.value.exit_code == 2


def test_names_that_are_no_settings_are_told_with_the_nearest_one(empty_place, monkeypatch):
    (empty_place / ".env").write_text(
        "YOUTUBE_APIKEY=hunter2\nREDDIT_CLIENT=hunter2\nKB_PROFILES=hunter2\nKB_XYZZY=hunter2\n"
        "ZENODO_TOKEN=hunter2\nyoutube_api_key=hunter2\nPATH_TO_IT=hunter2\nexport KB_DAT=hunter2\n"
    )
    monkeypatch.setenv("KB_CONTACTS", "hunter2")
    monkeypatch.setenv("REDDIT_USER", "another program's")
    told = unknown_names()
    assert [line.split(" is not a setting")[0] for line in told] == [
        "YOUTUBE_APIKEY in .env",
        "REDDIT_CLIENT in .env",
        "KB_PROFILES in .env",
        "KB_XYZZY in .env",
        "KB_DAT in .env",
        "KB_CONTACTS in the environment",
    ]
    assert told[0].endswith("did you mean YOUTUBE_API_KEY?")
    assert told[1].endswith("did you mean REDDIT_CLIENT_ID?")
    assert told[2].endswith("did you mean KB_PROFILE?")
    assert told[3].endswith("see .env.example")
    assert told[5].endswith("did you mean KB_CONTACT?")
    assert "hunter2" not in "".join(told)
    assert unknown_names(dotenv=False) == told[5:]
