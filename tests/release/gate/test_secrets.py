"""No file and no column of a release holds a secret."""

import json
from pathlib import Path

import pyarrow as pa
import pytest

from kb.release.gate.contents import SecretPatterns
from tests.recipes import release
from tests.release.conftest import SECRETS, a_run
from tests.release.gate.refusals import changed, refused, rewritten
from tests.release.made import build


@pytest.mark.parametrize("key", SECRETS)
def test_literal_value_of_every_secret_setting(tmp_path: Path, key: str) -> None:
    build(
        tmp_path,
        changed("youtube/videos", lambda row: row.update(title=f"my key is {SECRETS[key]} ok")),
        ("youtube",),
    )
    lines = refused(tmp_path)
    assert lines == [
        (
            "secret: youtube/videos-00000-of-00002.parquet:"
            " column title contains the value of a setting"
        )
    ]
    assert not any(value in line for line in lines for value in SECRETS.values())


@pytest.mark.parametrize(
    ("text", "what"),
    [
        ("AIza" + "Sy0" * 11 + "ab", "a Google API key"),
        ("ghp_" + "a1" * 18, "a GitHub token"),
        ("hf_" + "Ab" * 17, "a Hugging Face token"),
        ("AKIA" + "Z9" * 8, "an AWS access key"),
        ("-----BEGIN RSA PRIVATE KEY-----", "a private key"),
        ("https://x.example/?access_token=" + "f0" * 12, "a secret in an address"),
    ],
)
def test_shapes_of_keys(tmp_path: Path, text: str, what: str) -> None:
    build(
        tmp_path,
        changed("wiki/elements", lambda row: row.update(text=f"see {text} there")),
        ("wiki",),
    )
    assert refused(tmp_path) == [
        f"secret: wiki/elements-00000-of-00001.parquet: column text contains {what}"
    ]


def test_a_key_within_a_list(tmp_path: Path) -> None:
    names = ["ghp_" + "a1" * 18, "plain"]
    build(tmp_path, changed("links/entities", lambda row: row.update(aliases=names)), ("links",))
    assert (
        "secret: links/entities-00000-of-00001.parquet: column aliases contains a GitHub token"
        in refused(tmp_path)
    )


def test_a_key_does_not_begin_in_one_text_and_end_in_the_next(tmp_path: Path) -> None:
    names = ["ghp_" + "a1" * 9, "a1" * 9]
    build(tmp_path, changed("links/entities", lambda row: row.update(aliases=names)), ("links",))
    release(a_run(tmp_path))


def test_secret_in_the_profile_that_the_card_would_show(tmp_path: Path) -> None:
    from kb.core.installation import folder

    build(tmp_path, sources=("youtube",))
    shipped = (folder("profiles") / "minecraft" / "profile.toml").read_text()
    import tomllib

    kept = {
        key: value
        for key, value in tomllib.loads(shipped).items()
        if key in ("name", "title", "seed")
    }
    profile = tmp_path / "mine.toml"
    profile.write_text(
        "\n".join(f"{key} = {json.dumps(value)}" for key, value in kept.items())
        + f'\n[release]\ncontact = "{SECRETS["zenodo_token"]}"\ncreators = [{{ name = "Me" }}]\n'
        + 'licenses = { youtube = "CC-BY-4.0" }\n'
    )
    lines = refused(tmp_path, profile=profile)
    assert "secret: youtube/README.md: it contains the value of a setting" in lines
    assert not any(SECRETS["zenodo_token"] in line for line in lines)


@pytest.mark.parametrize(
    "name", ["notes.csv", "settings.env", "conf.yaml", "images-00000-of-00001.tar"]
)
def test_shapes_of_keys_in_any_file_also_across_pieces(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    monkeypatch.setattr("kb.release.gate.contents._CHUNK", 5000)
    build(tmp_path, sources=("youtube",))
    (tmp_path / "release" / "youtube" / name).write_bytes(
        b"\xff" * 4985 + b" ghp_" + b"a1" * 18 + b" " * 9000
    )
    assert f"secret: youtube/{name}: it contains a GitHub token" in refused(tmp_path)


@pytest.mark.parametrize(
    ("held", "what"),
    [
        (b"ya29.eyJ" + b"a" * 30 + b".eyJ" + b"b" * 30 + b".", "a Google access token"),
        (b"ya29.eyJ" + b"a" * 30 + b".eyJ" + b"b" * 30 + b".", "a JSON web token"),
        (b"api_key=AIza" + b"Sy0" * 11 + b"ab", "a Google API key"),
        (b"api_key=AIza" + b"Sy0" * 11 + b"ab", "a secret in an address"),
        (b"ghp_AKIA" + b"Q" * 16, "an AWS access key"),
        (b"ghp_hunter22", "the value of a setting"),
        (b"key=ghp_ AKIA xoxb-", None),
    ],
)
def test_a_secret_that_begins_within_another(held: bytes, what: str | None) -> None:
    found = list(SecretPatterns(["hunter22"]).within(b"x" * 99 + held + b" "))
    assert what in found if what else not found


@pytest.mark.parametrize("place", ["table", "column"])
def test_shapes_of_keys_in_parquet_metadata(tmp_path: Path, place: str) -> None:
    build(tmp_path, sources=("pairs",))
    key = {b"note": b"AIza" + b"Sy0" * 11 + b"ab"}

    def noted(rows: pa.Table) -> pa.Table:
        if place == "table":
            return rows.replace_schema_metadata(key)
        return rows.cast(
            pa.schema([rows.schema.field(0).with_metadata(key), *list(rows.schema)[1:]])
        )

    rewritten(tmp_path / "release" / "pairs" / "pairs-00000-of-00001.parquet", noted)
    assert refused(tmp_path) == [
        "secret: pairs/pairs-00000-of-00001.parquet: its metadata contains a Google API key"
    ]
