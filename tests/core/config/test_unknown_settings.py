"""Tests of `kb.core.config.unknown_settings`."""

from kb.core.config.unknown_settings import unknown_names


def test_names_that_are_no_settings_are_told_with_the_nearest_one(empty_place, monkeypatch):
    (empty_place / ".env").write_text(
        "YOUTUBE_APIKEY=hunter2\nREDDIT_CLIENT=hunter2\nKB_PROFILES=hunter2\nKB_XYZZY=hunter2\n"
        "ZENODO_TOKEN=hunter2\nyoutube_api_key=hunter2\nPATH_TO_IT=hunter2\nexport KB_DAT=hunter2\n"
    )
    monkeypatch.setenv("KB_CONTACTS", "hunter2")
    monkeypatch.setenv("REDDIT_USER", "another program's")
    told = unknown_names()
    assert [line.split(" is no setting")[0] for line in told] == [
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
