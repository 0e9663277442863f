"""The gate: one wrong value at a time, and its line. All lines come at once."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from kb.core.errors import ReleaseRefused
from kb.release.build import release
from tests.release.conftest import SECRETS, a_run
from tests.release.made import build

Rows = list[dict[str, Any]]


def refused(root: Path, **options: Any) -> list[str]:
    """The gate's lines."""
    with pytest.raises(ReleaseRefused) as caught:
        release(a_run(root, **options))
    return caught.value.problems  # type: ignore[attr-defined, no-any-return]


def changed(name: str, change: Callable[[dict[str, Any]], object], rows: slice = slice(0, 1)) -> Callable[[str, Rows], None]:
    """An edit of made rows."""

    def edit(table: str, made: Rows) -> None:
        for row in made[rows] if table == name else []:
            change(row)

    return edit


def rewritten(path: Path, change: Callable[[pa.Table], pa.Table]) -> None:
    pq.write_table(change(pq.read_table(path)), path)


def test_nothing_exported(tmp_path: Path) -> None:
    with pytest.raises(ReleaseRefused, match="nothing to release"):
        release(a_run(tmp_path))


@pytest.mark.parametrize("key", SECRETS)
def test_literal_value_of_every_secret_setting(tmp_path: Path, key: str) -> None:
    build(tmp_path, changed("youtube/videos", lambda row: row.update(title=f"my key is {SECRETS[key]} ok")), ("youtube",))
    lines = refused(tmp_path)
    assert lines == ["secret: youtube/videos-00000-of-00002.parquet: column title holds the value of a setting"]
    assert not any(value in line for line in lines for value in SECRETS.values())


@pytest.mark.parametrize(
    ("text", "what"),
    [
        ("AIza" + "Sy0" * 11 + "ab", "a Google API key"),
        ("ghp_" + "a1" * 18, "a GitHub token"),
        ("AKIA" + "Z9" * 8, "an AWS access key"),
        ("-----BEGIN RSA PRIVATE KEY-----", "a private key"),
        ("https://x.example/?access_token=" + "f0" * 12, "a secret in an address"),
    ],
)
def test_shapes_of_keys(tmp_path: Path, text: str, what: str) -> None:
    build(tmp_path, changed("wiki/elements", lambda row: row.update(text=f"see {text} there")), ("wiki",))
    assert refused(tmp_path) == [f"secret: wiki/elements-00000-of-00001.parquet: column text holds {what}"]


def test_secret_in_the_profile_that_the_card_would_show(tmp_path: Path) -> None:
    from kb.core.resources import folder

    build(tmp_path, sources=("youtube",))
    shipped = (folder("profiles") / "minecraft" / "profile.toml").read_text()
    import tomllib

    kept = {key: value for key, value in tomllib.loads(shipped).items() if key in ("name", "title", "seed")}
    profile = tmp_path / "mine.toml"
    profile.write_text(
        "\n".join(f"{key} = {json.dumps(value)}" for key, value in kept.items()) + f'\n[release]\ncontact = "{SECRETS["zenodo_token"]}"\n'
    )
    lines = refused(tmp_path, profile=profile)
    assert "secret: youtube/README.md: it holds the value of a setting" in lines
    assert not any(SECRETS["zenodo_token"] in line for line in lines)


@pytest.mark.parametrize("column", ["title", "body", "author_hash", "source_url"])
def test_content_columns_of_reddit(tmp_path: Path, column: str) -> None:
    build(tmp_path, sources=("reddit",))
    shard = tmp_path / "release" / "reddit" / "posts-00000-of-00001.parquet"
    rewritten(shard, lambda rows: rows.append_column(column, pa.array(["x"] * rows.num_rows)))
    assert refused(tmp_path) == [f"content: reddit/posts-00000-of-00001.parquet: column {column} may not be released"]


@pytest.mark.parametrize("text", ["a title that somebody wrote", "https://i.redd.it/abc.png", "u/somebody"])
def test_content_hidden_in_a_released_column_of_reddit(tmp_path: Path, text: str) -> None:
    build(tmp_path, changed("reddit/comments", lambda row: row.update(score_source=text)), ("reddit",))
    assert "content: reddit/comments-00000-of-00001.parquet: column score_source holds text that is no id" in refused(tmp_path)


@pytest.mark.parametrize(
    ("table", "column", "text"),
    [
        ("youtube/videos", "toxicity_title", "title"),
        ("youtube/videos", "toxicity_description", "description"),
        ("reddit/posts", "toxicity_body", "body"),
        ("reddit/comments", "toxicity_body", "body"),
        ("wiki/pages", "toxicity", "the page's text"),
    ],
)
def test_text_without_score(tmp_path: Path, table: str, column: str, text: str) -> None:
    build(tmp_path, changed(table, lambda row: row.update({column: None}), slice(0, 3)), (table.partition("/")[0],))
    assert refused(tmp_path) == [f"toxicity: {table}: 3 rows have no toxicity score of {text}; run `kb annotate`"]


def test_empty_text_needs_no_score(tmp_path: Path) -> None:
    build(
        tmp_path,
        changed("youtube/videos", lambda row: row.update(description="", toxicity_description=None)),
        ("youtube",),
    )
    assert release(a_run(tmp_path))["folders"] == 1


def test_undescribed_column(tmp_path: Path) -> None:
    build(tmp_path, sources=("youtube",))
    rewritten(
        tmp_path / "release" / "youtube" / "videos-00001-of-00002.parquet",
        lambda rows: rows.append_column("mood", pa.array(["x"] * rows.num_rows)),
    )
    assert refused(tmp_path) == ["undescribed: youtube/videos-00001-of-00002.parquet: column mood is not described in schemas/"]


def test_column_of_another_type_or_missing(tmp_path: Path) -> None:
    build(tmp_path, sources=("youtube",))
    rewritten(
        tmp_path / "release" / "youtube" / "videos-00000-of-00002.parquet",
        lambda rows: rows.drop_columns(["fps"]).set_column(rows.column_names.index("width"), "width", rows["width"].cast(pa.string())),
    )
    lines = refused(tmp_path)
    assert "undescribed: youtube/videos-00000-of-00002.parquet: column width is string, schemas/ says int64" in lines
    assert "undescribed: youtube/videos-00000-of-00002.parquet: column fps is missing" in lines


def test_rows_that_differ_from_clean(tmp_path: Path) -> None:
    build(tmp_path, sources=("pairs",))
    rewritten(tmp_path / "release" / "pairs" / "pairs-00000-of-00001.parquet", lambda rows: rows.slice(1))
    assert refused(tmp_path) == ["rows: pairs/pairs: 119 released, 120 clean; run the export again"]


def test_table_that_was_never_exported(tmp_path: Path) -> None:
    build(tmp_path, sources=("reddit",))
    (tmp_path / "release" / "reddit" / "comments-00000-of-00001.parquet").unlink()
    assert refused(tmp_path) == ["rows: reddit/comments: is clean but not exported; run the export again"]


def test_lost_shard(tmp_path: Path) -> None:
    build(tmp_path, sources=("youtube",))
    (tmp_path / "release" / "youtube" / "videos-00001-of-00002.parquet").unlink()
    assert any(line.startswith("damaged: youtube/videos: shards are missing") for line in refused(tmp_path))


def test_wiki_without_licence(tmp_path: Path) -> None:
    build(tmp_path, changed("wiki/pages", lambda row: row.update(license=None), slice(None)), ("wiki",))
    profile = tmp_path / "mine.toml"
    profile.write_text('name = "mine"\ntitle = "Mine"\n')
    assert refused(tmp_path, profile=profile) == ["licence: wiki/LICENSE: none is given; set wiki in [release.licenses] of the profile"]


def test_damaged_shard_is_a_line_and_no_crash(tmp_path: Path) -> None:
    build(tmp_path, sources=("youtube",))
    shard = tmp_path / "release" / "youtube" / "videos-00000-of-00002.parquet"
    shard.write_bytes(shard.read_bytes()[:500])
    lines = refused(tmp_path)
    assert any(line.startswith("damaged: youtube/videos-00000-of-00002.parquet: can't be read") for line in lines)


def test_data_changed_after_the_release(tmp_path: Path) -> None:
    build(tmp_path, sources=("pairs",))
    release(a_run(tmp_path))
    shard = tmp_path / "release" / "pairs" / "pairs-00000-of-00001.parquet"
    rewritten(
        shard,
        lambda rows: rows.set_column(rows.column_names.index("keyword"), "keyword", pa.array(["x"] * rows.num_rows)),
    )
    assert refused(tmp_path) == ["checksum: pairs/pairs-00000-of-00001.parquet: differs from SHA256SUMS; export it again"]


@pytest.mark.parametrize(
    ("text", "what", "key", "rate"),
    [
        ("write to jane.doe+x@mail.example.org please", "an e-mail address", "emails_per_thousand", "0.2"),
        ("call +1 (555) 010-9999 now", "a phone number", "phones_per_thousand", "0.5"),
        ("call 555-010-9999", "a phone number", "phones_per_thousand", "0.5"),
    ],
)
def test_personal_data_beyond_tolerance(tmp_path: Path, text: str, what: str, key: str, rate: str) -> None:
    build(tmp_path, changed("wiki/cells", lambda row: row.update(text=text)), ("wiki",))
    assert refused(tmp_path) == [f"personal data: wiki/cells: 1 of 36 rows have {what} in text, [release] {key} tolerates {rate} per 1,000"]


@pytest.mark.parametrize(
    "text",
    [
        "version 1.20.4",
        "at 1200 64 -300",
        "2026-11-01",
        "seed 4-8-15-16-23-42",
        "3.14159265",
        "meet @ the castle",
        "user@home",
    ],
)
def test_game_talk_is_no_personal_data(tmp_path: Path, text: str) -> None:
    build(tmp_path, changed("wiki/cells", lambda row: row.update(text=text), slice(None)), ("wiki",))
    assert release(a_run(tmp_path))["folders"] == 1


def test_rows_too_old(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    build(tmp_path, sources=("youtube",))
    monkeypatch.setenv("KB_NOW", "2026-12-02T00:00:00Z")
    lines = refused(tmp_path)
    assert lines == [("age: youtube/videos: 24 rows were read more than 30 days ago (the oldest on 2026-11-01); run `kb refresh youtube`")]


def test_toxicity_off_is_reported_as_incomplete(tmp_path: Path) -> None:
    def edit(name: str, made: Rows) -> None:
        for row in made:
            row.update({"toxicity_title": None, "toxicity_description": None} if name == "youtube/videos" else {})

    build(tmp_path, edit, ("youtube",))
    profile = tmp_path / "mine.toml"
    profile.write_text('name = "mine"\ntitle = "Mine"\ntoxicity = "off"\n')
    assert all("the release is incomplete, toxicity is off in the profile" in line for line in refused(tmp_path, profile=profile))


def test_everything_is_said_at_once(tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    def edit(name: str, made: Rows) -> None:
        if name == "youtube/videos":
            made[0]["title"] = f"{SECRETS['youtube_api_key']} and jane@mail.example"
            made[1]["toxicity_title"] = None

    build(tmp_path, edit)
    rewritten(tmp_path / "release" / "pairs" / "pairs-00000-of-00001.parquet", lambda rows: rows.slice(2))
    monkeypatch.setenv("YOUTUBE_API_KEY", SECRETS["youtube_api_key"])
    from kb.cli.app import main

    with pytest.raises(SystemExit) as left:
        main(["release", "--data", str(tmp_path), "--quiet"])
    assert left.value.code == 1
    said = capsys.readouterr().err.splitlines()
    assert sorted({line.partition(":")[0] for line in said}) == ["kb", "personal data", "rows", "secret", "toxicity"]
    assert said[-1].startswith("kb: the release is refused for 4 reasons")
    assert not any(SECRETS["youtube_api_key"] in line for line in said)
    assert not (tmp_path / "release" / "youtube" / "README.md").exists()
