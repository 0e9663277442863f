"""The gate: one wrong value at a time, and its line. All lines come at once."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from kb.core.errors import DamagedData, ReleaseRefused
from kb.release.build import release
from kb.release.gate import secrets as scan
from tests.release.conftest import SECRETS, a_run
from tests.release.made import build

Rows = list[dict[str, Any]]


def refused(root: Path, **options: Any) -> list[str]:
    """The gate's lines."""
    with pytest.raises(ReleaseRefused) as caught:
        release(a_run(root, **options))
    return caught.value.problems  # type: ignore[attr-defined, no-any-return]


def changed(
    name: str, change: Callable[[dict[str, Any]], object], rows: slice = slice(0, 1)
) -> Callable[[str, Rows], None]:
    """An edit of made rows."""

    def edit(table: str, made: Rows) -> None:
        for row in made[rows] if table == name else []:
            change(row)

    return edit


def rewritten(path: Path, change: Callable[[pa.Table], pa.Table]) -> None:
    pq.write_table(change(pq.read_table(path)), path)


def with_first(rows: pa.Table, column: str, value: object) -> pa.Table:
    """The rows with another value of `column` in the first one."""
    index = rows.column_names.index(column)
    return rows.set_column(
        index,
        rows.schema.field(index).with_nullable(True),
        pa.array([value, *rows[column].to_pylist()[1:]], rows.schema.field(index).type),
    )


def test_nothing_exported(tmp_path: Path) -> None:
    with pytest.raises(ReleaseRefused, match="nothing to release"):
        release(a_run(tmp_path))


@pytest.mark.parametrize("key", SECRETS)
def test_literal_value_of_every_secret_setting(tmp_path: Path, key: str) -> None:
    build(
        tmp_path,
        changed("youtube/videos", lambda row: row.update(title=f"my key is {SECRETS[key]} ok")),
        ("youtube",),
    )
    lines = refused(tmp_path)
    assert lines == [
        "secret: youtube/videos-00000-of-00002.parquet: column title holds the value of a setting"
    ]
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
    build(
        tmp_path,
        changed("wiki/elements", lambda row: row.update(text=f"see {text} there")),
        ("wiki",),
    )
    assert refused(tmp_path) == [
        f"secret: wiki/elements-00000-of-00001.parquet: column text holds {what}"
    ]


def test_secret_in_the_profile_that_the_card_would_show(tmp_path: Path) -> None:
    from kb.core.resources import folder

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
        + f'\n[release]\ncontact = "{SECRETS["zenodo_token"]}"\n'
    )
    lines = refused(tmp_path, profile=profile)
    assert "secret: youtube/README.md: it holds the value of a setting" in lines
    assert not any(SECRETS["zenodo_token"] in line for line in lines)


@pytest.mark.parametrize("column", ["title", "body", "author_hash", "source_url"])
def test_content_columns_of_reddit(tmp_path: Path, column: str) -> None:
    build(tmp_path, sources=("reddit",))
    shard = tmp_path / "release" / "reddit" / "posts-00000-of-00001.parquet"
    rewritten(shard, lambda rows: rows.append_column(column, pa.array(["x"] * rows.num_rows)))
    assert refused(tmp_path) == [
        f"content: reddit/posts-00000-of-00001.parquet: column {column} may not be released"
    ]


@pytest.mark.parametrize(
    "text", ["a title that somebody wrote", "https://i.redd.it/abc.png", "u/somebody"]
)
def test_content_hidden_in_a_released_column_of_reddit(tmp_path: Path, text: str) -> None:
    build(
        tmp_path, changed("reddit/comments", lambda row: row.update(score_source=text)), ("reddit",)
    )
    assert (
        "content: reddit/comments-00000-of-00001.parquet: column score_source contains text"
        " that is not an id"
    ) in refused(tmp_path)


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
    build(
        tmp_path,
        changed(table, lambda row: row.update({column: None}), slice(0, 3)),
        (table.partition("/")[0],),
    )
    source = table.partition("/")[0]
    again = f"run `kb {source} filter` and `kb {source} export` again"
    assert refused(tmp_path) == [
        f"toxicity: {table}: 3 rows have no toxicity score of {text}; {again}"
    ]


def test_empty_text_needs_no_score(tmp_path: Path) -> None:
    build(
        tmp_path,
        changed(
            "youtube/videos", lambda row: row.update(description="", toxicity_description=None)
        ),
        ("youtube",),
    )
    assert release(a_run(tmp_path))["folders"] == 1


def test_undescribed_column(tmp_path: Path) -> None:
    build(tmp_path, sources=("youtube",))
    rewritten(
        tmp_path / "release" / "youtube" / "videos-00001-of-00002.parquet",
        lambda rows: rows.append_column("mood", pa.array(["x"] * rows.num_rows)),
    )
    assert refused(tmp_path) == [
        (
            "undescribed: youtube/videos-00001-of-00002.parquet:"
            " column mood is not described in schemas/"
        )
    ]


def test_column_of_another_type_or_missing(tmp_path: Path) -> None:
    build(tmp_path, sources=("youtube",))
    rewritten(
        tmp_path / "release" / "youtube" / "videos-00000-of-00002.parquet",
        lambda rows: rows.drop_columns(["fps"]).set_column(
            rows.column_names.index("width"), "width", rows["width"].cast(pa.string())
        ),
    )
    lines = refused(tmp_path)
    assert (
        "undescribed: youtube/videos-00000-of-00002.parquet: column width is string,"
        " schemas/ says int64"
    ) in lines
    assert "undescribed: youtube/videos-00000-of-00002.parquet: column fps is missing" in lines


def test_rows_that_differ_from_clean(tmp_path: Path) -> None:
    build(tmp_path, sources=("pairs",))
    rewritten(
        tmp_path / "release" / "pairs" / "pairs-00000-of-00001.parquet", lambda rows: rows.slice(1)
    )
    assert refused(tmp_path) == ["rows: pairs/pairs: 119 released, 120 clean; run the export again"]


def test_table_that_was_never_exported(tmp_path: Path) -> None:
    build(tmp_path, sources=("reddit",))
    (tmp_path / "release" / "reddit" / "comments-00000-of-00001.parquet").unlink()
    assert refused(tmp_path) == [
        "rows: reddit/comments: is clean but not exported; run the export again"
    ]


def test_lost_shard(tmp_path: Path) -> None:
    build(tmp_path, sources=("youtube",))
    (tmp_path / "release" / "youtube" / "videos-00001-of-00002.parquet").unlink()
    assert any(
        line.startswith("damaged: youtube/videos: shards are missing") for line in refused(tmp_path)
    )


def test_wiki_without_licence(tmp_path: Path) -> None:
    build(
        tmp_path,
        changed("wiki/pages", lambda row: row.update(license=None), slice(None)),
        ("wiki",),
    )
    profile = tmp_path / "mine.toml"
    profile.write_text('name = "mine"\ntitle = "Mine"\n')
    assert refused(tmp_path, profile=profile) == [
        "licence: wiki/LICENSE: none is given; set wiki in [release.licenses] of the profile"
    ]


def test_wiki_under_a_licence_that_no_release_can_carry(tmp_path: Path) -> None:
    build(
        tmp_path,
        changed(
            "wiki/pages",
            lambda row: row.update(license="https://wiki.example.org/terms"),
            slice(None),
        ),
        ("wiki",),
    )
    profile = tmp_path / "mine.toml"
    profile.write_text(
        'name = "mine"\ntitle = "Mine"\n[release.licenses]\nwiki = "CC-BY-NC-SA-3.0"\n'
    )
    (line,) = refused(tmp_path, profile=profile)
    assert line.startswith(
        "licence: wiki/LICENSE: the pages name https://wiki.example.org/terms,"
        " which is not a licence that a release can use"
    )


def test_some_pages_without_licence(tmp_path: Path) -> None:
    build(
        tmp_path,
        changed("wiki/pages", lambda row: row.update(license=None), slice(0, 2)),
        ("wiki",),
    )
    assert refused(tmp_path) == [
        "licence: wiki/pages: 2 rows name no licence, though others do; run `kb wiki crawl --again`"
    ]


@pytest.mark.parametrize(
    ("source", "name"),
    [
        ("reddit", "reddit.json"),
        ("reddit", "posts.csv"),
        ("reddit", "posts-1-of-1.parquet"),
        ("reddit", "sample-bodies.parquet"),
        ("reddit", "bodies.sample.json"),
        ("youtube", "LICENSE-mine.txt"),
        ("youtube", "images-00000-of-00001.tar"),
        ("youtube", "settings.env"),
        ("reddit", "sample-posts.parquet"),
    ],
)
def test_undeclared_files(tmp_path: Path, source: str, name: str) -> None:
    build(tmp_path, sources=(source,))
    (tmp_path / "release" / source / name).write_text("text")
    assert refused(tmp_path) == [
        f"undeclared file: {source}/{name}: is not part of a release; remove it"
    ]


def test_links_are_not_followed(tmp_path: Path) -> None:
    build(tmp_path, sources=("youtube",))
    (tmp_path / "outside").write_text("not ours")
    for name in ("extra.txt", "README.md", "DATASHEET.md"):
        (tmp_path / "release" / "youtube" / name).symlink_to(
            tmp_path / ("nowhere" if name == "DATASHEET.md" else "outside")
        )
    assert refused(tmp_path) == [
        f"undeclared file: youtube/{name}: is a link; a release needs real files"
        for name in ("DATASHEET.md", "README.md", "extra.txt")
    ]


def test_sample_in_json_with_content(tmp_path: Path) -> None:
    build(tmp_path, sources=("reddit",))
    release(a_run(tmp_path))
    path = tmp_path / "release" / "reddit" / "posts.sample.json"
    rows = json.loads(path.read_text())
    for edit, line in (
        ({"title": "x"}, "content: {}: column title may not be released"),
        ({"mood": "x"}, "undescribed: {}: column mood is not described in schemas/"),
        (
            {"post_id": "somebody wrote this"},
            "content: {}: column post_id contains text that is not an id",
        ),
        ({"type": "poem"}, "content: {}: column type contains other values than "),
        ({"score": "many"}, "undescribed: {}: column score contains other values than int64"),
        ({"post_id": None}, "null: {}: column post_id has rows without a value"),
        (
            {"created_utc": "soon"},
            "undescribed: {}: column created_utc contains other values than ",
        ),
    ):
        path.write_text(json.dumps([rows[0] | edit, *rows[1:]]))
        wanted = line.format("reddit/posts.sample.json")
        assert any(said.startswith(wanted) for said in refused(tmp_path)), line
    path.write_text(json.dumps(rows))
    release(a_run(tmp_path))


@pytest.mark.parametrize(
    "name", ["notes.csv", "settings.env", "conf.yaml", "images-00000-of-00001.tar"]
)
def test_shapes_of_keys_in_any_file_also_across_pieces(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    monkeypatch.setattr("kb.release.gate.secrets._CHUNK", 5000)
    build(tmp_path, sources=("youtube",))
    (tmp_path / "release" / "youtube" / name).write_bytes(
        b"\xff" * 4985 + b" ghp_" + b"a1" * 18 + b" " * 9000
    )
    assert f"secret: youtube/{name}: it holds a GitHub token" in refused(tmp_path)


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
    found = list(scan.SecretPatterns(["hunter22"]).within(b"x" * 99 + held + b" "))
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
        "secret: pairs/pairs-00000-of-00001.parquet: its metadata holds a Google API key"
    ]


@pytest.mark.parametrize(
    ("table", "column", "text"),
    [("youtube/videos", "toxicity_title", "title"), ("wiki/pages", "toxicity", "the page's text")],
)
def test_released_text_without_score(tmp_path: Path, table: str, column: str, text: str) -> None:
    source, _, short = table.partition("/")
    build(tmp_path, sources=(source,))
    shard = next((tmp_path / "release" / source).glob(f"{short}-00000-*"))
    rewritten(shard, lambda rows: with_first(rows, column, None))
    assert refused(tmp_path) == [
        f"toxicity: {table}: 1 released rows have no toxicity score of {text}; run the export again"
    ]


def test_null_where_the_schema_knows_none(tmp_path: Path) -> None:
    build(tmp_path, sources=("youtube",))
    shard = tmp_path / "release" / "youtube" / "videos-00000-of-00002.parquet"
    rewritten(shard, lambda rows: with_first(rows, "fetched_at", None))
    (line,) = refused(tmp_path)
    assert line.startswith(
        "null: youtube/videos-00000-of-00002.parquet: column fetched_at has rows without a value"
    )


def test_a_wiki_without_a_recipe_is_released_again(tmp_path: Path) -> None:
    """An empty table, whose sample lies there the second time, holds no wrong word."""

    def edit(table: str, made: Rows) -> None:
        if table == "wiki/recipes":
            made.clear()

    build(tmp_path, edit, sources=("wiki",))
    for _ in range(2):
        release(a_run(tmp_path))
        sample = tmp_path / "release" / "wiki" / "recipes.sample.json"
        assert json.loads(sample.read_bytes()) == []


@pytest.mark.parametrize(
    ("table", "column", "text"),
    [
        ("comments", "score_source", "Notch_1990"),
        ("posts", "type", "u_SomeAuthor"),
        ("posts", "post_id", "SomeAuthor"),
        ("comments", "parent_id", "u_author"),
        ("comments", "comment_id", "abc\nd"),
    ],
)
def test_a_name_where_reddit_has_words_and_ids(
    tmp_path: Path, table: str, column: str, text: str
) -> None:
    build(tmp_path, sources=("reddit",))
    where = f"reddit/{table}-00000-of-00001.parquet"
    rewritten(tmp_path / "release" / where, lambda rows: with_first(rows, column, text))
    (line,) = refused(tmp_path)
    assert line.startswith(f"content: {where}: column {column} contains ")
    assert text not in line


def test_archives_that_are_gone_or_cut_off(tmp_path: Path) -> None:
    build(tmp_path, sources=("wiki",))
    wiki = tmp_path / "release" / "wiki"
    images, screenshots = (
        wiki / "images-00000-of-00001.tar",
        wiki / "screenshots-00000-of-00001.tar",
    )
    whole = images.read_bytes()
    images.write_bytes(whole[:1024])
    (line,) = refused(tmp_path)
    assert re.fullmatch(
        r"damaged: wiki/images-00000-of-00001\.tar: is cut off:"
        r" \d+ of its files end beyond it; run `kb wiki export` again",
        line,
    )
    images.write_bytes(whole)
    release(a_run(tmp_path))
    screenshots.unlink()
    lines = refused(tmp_path)
    assert (
        f"checksum: wiki/{screenshots.name}: is in SHA256SUMS but missing; export it again" in lines
    )
    assert any(
        line.startswith(
            f"damaged: wiki/{screenshots.name}: is missing; index.ndjson names 12 files in it"
        )
        for line in lines
    )


@pytest.mark.parametrize("text", [None, "{", ""])
def test_index_that_is_gone_or_damaged(tmp_path: Path, text: str | None) -> None:
    build(tmp_path, sources=("wiki",))
    index = tmp_path / "release" / "wiki" / "index.ndjson"
    index.unlink() if text is None else index.write_text(text)
    lines = refused(tmp_path)
    assert lines
    assert all(
        line.startswith("damaged: wiki/") and line.endswith("run `kb wiki export` again")
        for line in lines
    )


@pytest.mark.parametrize(
    ("text", "file"),
    [
        ("youtube", "clean/youtube/videos/part-00000.parquet"),
        ("pairs", "pairs/part-00000.parquet"),
        ("pairs", "release/pairs/pairs.sample.json"),
    ],
)
def test_damaged_files_are_lines(tmp_path: Path, text: str, file: str) -> None:
    build(tmp_path, sources=(text,))
    release(a_run(tmp_path))
    path = tmp_path / file
    path.write_bytes(path.read_bytes()[:500])
    lines = refused(tmp_path)
    assert any(
        line.startswith(f"damaged: {file.removeprefix('release/')}: can't be read")
        and "again" in line
        for line in lines
    )


@pytest.mark.parametrize("data", [b"\xff\xfe garbage", b"words\n"])
def test_damaged_checksums_are_a_line(tmp_path: Path, data: bytes) -> None:
    build(tmp_path, sources=("pairs",))
    (tmp_path / "release" / "pairs" / "SHA256SUMS").write_bytes(data)
    (line,) = refused(tmp_path)
    assert line.startswith("damaged: pairs/SHA256SUMS: can't be read")


def test_damaged_shard_is_a_line_and_no_crash(tmp_path: Path) -> None:
    build(tmp_path, sources=("youtube",))
    shard = tmp_path / "release" / "youtube" / "videos-00000-of-00002.parquet"
    shard.write_bytes(shard.read_bytes()[:500])
    lines = refused(tmp_path)
    assert any(
        line.startswith("damaged: youtube/videos-00000-of-00002.parquet: can't be read")
        for line in lines
    )


def test_data_changed_after_the_release(tmp_path: Path) -> None:
    build(tmp_path, sources=("pairs",))
    release(a_run(tmp_path))
    shard = tmp_path / "release" / "pairs" / "pairs-00000-of-00001.parquet"
    rewritten(
        shard,
        lambda rows: rows.set_column(
            rows.column_names.index("keyword"), "keyword", pa.array(["x"] * rows.num_rows)
        ),
    )
    assert refused(tmp_path) == [
        "checksum: pairs/pairs-00000-of-00001.parquet: differs from SHA256SUMS; export it again"
    ]


@pytest.mark.parametrize(
    ("text", "what", "key", "rate"),
    [
        (
            "write to jane.doe+x@mail.example.org please",
            "an e-mail address",
            "emails_per_thousand",
            "0.2",
        ),
        ("call +1 (555) 010-9999 now", "a phone number", "phones_per_thousand", "0.5"),
        ("call 555-010-9999", "a phone number", "phones_per_thousand", "0.5"),
        ("mail jörg@exämple.de", "an e-mail address", "emails_per_thousand", "0.2"),
        ("appelez moi +33 6 12 34 56 78", "a phone number", "phones_per_thousand", "0.5"),
        ("ruf an 0171 1234567", "a phone number", "phones_per_thousand", "0.5"),
        ("WhatsApp me: 555 123 4567", "a phone number", "phones_per_thousand", "0.5"),
        ("+33612345678", "a phone number", "phones_per_thousand", "0.5"),
    ],
)
def test_personal_data_beyond_tolerance(
    tmp_path: Path, text: str, what: str, key: str, rate: str
) -> None:
    build(tmp_path, changed("wiki/cells", lambda row: row.update(text=text)), ("wiki",))
    assert refused(tmp_path) == [
        (
            f"personal data: wiki/cells: 1 of 36 rows have {what} in text,"
            f" [release] {key} tolerates {rate} per 1,000"
        )
    ]


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
        "100 200 3000",
        "at 255 64 1984",
        "+12 500 000 XP",
        "+3.14159265",
        "call it 1200 64 -300",
        "mobile version of 20.11.2026",
        "2026-11-01 12:00:00 +0100",
        "0101 0101 0101",
    ],
)
def test_game_talk_is_no_personal_data(tmp_path: Path, text: str) -> None:
    build(
        tmp_path, changed("wiki/cells", lambda row: row.update(text=text), slice(None)), ("wiki",)
    )
    assert release(a_run(tmp_path))["folders"] == 1


def test_rows_too_old(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    build(tmp_path, sources=("youtube",))
    monkeypatch.setenv("KB_NOW", "2026-12-02T00:00:00Z")
    lines = refused(tmp_path)
    assert lines == [
        (
            "age: youtube/videos: 24 rows were read more than 30 days ago (the oldest on"
            " 2026-11-01); run `kb refresh youtube`"
        )
    ]


def test_toxicity_off_is_reported_as_incomplete(tmp_path: Path) -> None:
    def edit(name: str, made: Rows) -> None:
        for row in made:
            row.update(
                {"toxicity_title": None, "toxicity_description": None}
                if name == "youtube/videos"
                else {}
            )

    build(tmp_path, edit, ("youtube",))
    profile = tmp_path / "mine.toml"
    profile.write_text('name = "mine"\ntitle = "Mine"\ntoxicity = "off"\n')
    assert all(
        "the release is incomplete, toxicity is off in the profile" in line
        for line in refused(tmp_path, profile=profile)
    )


def test_everything_is_said_at_once(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def edit(name: str, made: Rows) -> None:
        if name == "youtube/videos":
            made[0]["title"] = f"{SECRETS['youtube_api_key']} and jane@mail.example"
            made[1]["toxicity_title"] = None

    build(tmp_path, edit)
    rewritten(
        tmp_path / "release" / "pairs" / "pairs-00000-of-00001.parquet", lambda rows: rows.slice(2)
    )
    monkeypatch.setenv("YOUTUBE_API_KEY", SECRETS["youtube_api_key"])
    from kb.cli import main

    with pytest.raises(SystemExit) as left:
        main(["release", "--data", str(tmp_path), "--quiet"])
    assert left.value.code == 1
    said = capsys.readouterr().err.splitlines()
    assert sorted({line.partition(":")[0] for line in said}) == [
        "kb",
        "personal data",
        "rows",
        "secret",
        "toxicity",
    ]
    assert said[-1].startswith("kb: the release is refused for 4 reasons")
    assert not any(SECRETS["youtube_api_key"] in line for line in said)
    assert not (tmp_path / "release" / "youtube" / "README.md").exists()


def test_damaged_scores_are_a_line(tmp_path: Path) -> None:
    build(tmp_path, sources=("youtube",))
    (tmp_path / "annotations" / "youtube").mkdir(parents=True)
    (tmp_path / "annotations" / "youtube" / "part.parquet").write_bytes(b"PAR1 cut off")
    with pytest.raises(DamagedData, match=r"youtube can't be measured: .*part\.parquet"):
        release(a_run(tmp_path))
