"""release/open-text: transcripts under Creative Commons, with credit, and only where asked for."""

import json
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import duckdb
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

import kb
from kb.core.context import Run
from kb.export import open_text
from kb.schema.tables import table
from kb.store.tables.shard_writer import write_table
from tests.recipes import export, release
from tests.release.conftest import a_run
from tests.release.gate.refusals import refused as refusals
from tests.release.gate.refusals import rewritten, with_first
from tests.release.made import build
from tests.release.signed import signed

OPEN = [f"vid{i:08d}" for i in (2, 3, 5, 7)]
SHARD = "release/open-text/open_text-00000-of-00001.parquet"


@pytest.fixture(autouse=True)
def november(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("KB_NOW", "2026-11-10T00:00:00Z")


@pytest.fixture(scope="module")
def asked(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A profile that asks for the open text."""
    place = tmp_path_factory.mktemp("open")
    (place / "keywords.tsv").write_bytes((signed().parent / "keywords.tsv").read_bytes())
    text = signed().read_text(encoding="utf-8")
    path = place / "profile.toml"
    path.write_text(text.replace("[release]\n", "[release]\nopen_text = true\n", 1))
    return path


@pytest.fixture
def root(tmp_path: Path) -> Path:
    """Clean videos with transcripts, some under Creative Commons."""

    def edit(name: str, rows: list[dict[str, Any]]) -> None:
        for row in rows if name == "youtube/videos" else ():
            row["channel_title"] = f"Channel {row['channel_id'][-1]}"
            row["license"] = "creativeCommon" if row["video_id"] in OPEN else "youtube"

    root = build(tmp_path / "data", edit, sources=("youtube",))
    kinds = table("youtube/transcripts").arrow()
    videos = pq.read_table(root / "clean/youtube/videos/part-00000.parquet")
    cues = [{"start_s": 0.0, "duration_s": 2.0, "text": one} for one in ("now we", "build")]
    rows = [
        {
            "video_id": key,
            "kind": "manual",
            "language": "en",
            "cues": cues,
            "word_times": None,
            "read_from": "watch_page",
        }
        for key in videos["video_id"].to_pylist()
    ]
    path = root / "clean/youtube/transcripts/part-00000.parquet"
    write_table(path, pa.Table.from_pylist(rows, kinds), "youtube/transcripts")
    return root


@pytest.fixture
def run(root: Path, asked: Path) -> Run:
    return a_run(root, asked)


def test_a_row_has_the_text_and_what_credit_needs(root: Path, run: Run) -> None:
    assert export(run, "open-text")["open_text"] == len(OPEN)
    before = (root / SHARD).read_bytes()
    rows = duckdb.sql(
        f"""SELECT o.video_id, o.title = v.title AND o.link = v.link AND o.channel_id = v.channel_id
            AND o.channel_title = v.channel_title AND o.published_at = v.published_at
            AND o.word_count = v.word_count, o.license, o.text, len(o.cues)
        FROM read_parquet('{root}/{SHARD}') AS o
        JOIN read_parquet('{root}/clean/youtube/videos/*.parquet') AS v USING (video_id)"""
    ).fetchall()
    assert rows == [(key, True, "creativeCommon", "now we build", 2) for key in OPEN]
    export(run, "open-text")
    assert (root / SHARD).read_bytes() == before


def test_nothing_is_written_unless_the_profile_asks_and_it_goes_when_it_no_longer_does(
    root: Path, run: Run
) -> None:
    assert export(a_run(root), "open-text")["open_text"] == 0
    assert not (root / "release/open-text").exists()
    export(run, "open-text")
    assert refusals(root) == ["out of date: release/open-text: release.open_text true → false"]
    export(a_run(root), "open-text")
    assert not (root / "release/open-text").exists()
    assert release(a_run(root))["folders"] == 1


@pytest.mark.parametrize("column", ["title", "channel_title", "channel_id", "published_at"])
def test_a_video_without_credit_is_left_out(root: Path, run: Run, column: str) -> None:
    path = root / "clean/youtube/videos/part-00000.parquet"

    def without(rows: pa.Table) -> pa.Table:
        at = rows["video_id"].to_pylist().index(OPEN[0])
        values = rows[column].to_pylist()
        values[at] = None
        field = rows.schema.get_field_index(column)
        return rows.set_column(field, column, pa.array(values, rows[column].type))

    rewritten(path, without)
    summary = export(run, "open-text")
    assert (summary["open_text"], summary["uncredited"]) == (len(OPEN) - 1, 1)


@pytest.mark.parametrize(
    ("column", "value", "what"),
    [
        ("title", None, "null: .* column title has rows without a value"),
        ("link", "https://example.org", "content: .* column link contains other values"),
        ("channel_id", None, "null: .* column channel_id has rows without a value"),
        ("channel_title", " ", "content: .* column channel_title contains other values"),
        ("published_at", None, "null: .* column published_at has rows without a value"),
        ("license", "youtube", "content: .* column license contains other values than creative"),
    ],
)
def test_the_gate_refuses_a_row_without_credit_or_of_another_licence(
    root: Path,
    run: Run,
    column: str,
    value: str | None,
    what: str,
) -> None:
    export(run, "open-text")
    rewritten(root / SHARD, lambda rows: with_first(rows, column, value))
    # As if an export had written the row: without the digest that tells that the file was changed.
    (root / "state/manifests/release-open-text.json").unlink()
    lines = refusals(root, profile=run.profile.path)
    assert any(re.match(what, line) for line in lines), lines


def test_a_folder_that_is_older_than_the_clean_rows_is_refused(root: Path, run: Run) -> None:
    export(run, "open-text")
    path = root / "clean/youtube/videos/part-00000.parquet"
    rewritten(path, lambda rows: rows.slice(1))
    assert refusals(root, profile=run.profile.path) == [
        "out of date: release/open-text: clean/youtube"
    ]


def test_the_card_says_what_may_be_done_and_what_is_not_certain(root: Path, run: Run) -> None:
    export(run, "open-text")
    release(run)
    folder = root / "release/open-text"
    card = (folder / "README.md").read_text(encoding="utf-8")
    assert "license: cc-by-3.0" in card
    for said in (
        "Uploaders mislabel",
        "reading it takes no key",
        "You may share and adapt the texts",
        "YouTube's terms of service apply",
    ):
        assert said in card
    assert "Attribution 3.0 Unported" in (folder / "LICENSE").read_text(encoding="utf-8")
    assert json.loads((folder / "zenodo.json").read_text())["metadata"]["license"] == "cc-by-3.0"
    data = kb.load(folder)
    assert data["open_text"].to_pylist(["video_id"]) == [{"video_id": key} for key in OPEN]


def test_without_any_such_video_there_is_no_folder(root: Path, run: Run) -> None:
    rewritten(
        root / "clean/youtube/videos/part-00000.parquet",
        lambda rows: rows.set_column(
            rows.schema.get_field_index("license"),
            "license",
            pa.array(["youtube"] * rows.num_rows, rows["license"].type),
        ),
    )
    said: list[str] = []

    class Told(type(run.progress)):  # type: ignore[misc]
        def say(self, line: str) -> None:
            said.append(line)

    assert open_text.export(replace(run, progress=Told()))["open_text"] == 0
    assert said == ["no kept video with a transcript is under Creative Commons"]
    assert not (root / "release/open-text").exists()
