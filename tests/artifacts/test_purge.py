"""The frame of every purge: its lists of keys and its plan, raw answers, rows, what is named."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from kb.artifacts import purge
from kb.artifacts.purge_raw import Matcher, changed_frames, rewrite_segment, strip_by_schema
from kb.artifacts.purge_rows import RowLocation, drop_rows
from kb.core.config.pipeline import Recipe
from kb.core.errors import DamagedData, FatalError, SettingError
from kb.core.progress import LineProgress
from kb.crawl.purge import dry_purge
from kb.filters.filter_run import run_clean
from kb.reddit.purge import texts
from kb.registry import SOURCES as CLASSES
from kb.store.layout import Layout
from kb.store.rawlog import rawlog
from kb.store.rawlog.rawlog import Envelope, Request
from kb.store.state import tombstones
from tests.artifacts.purged import COUNTS, purged
from tests.filters.made import MONDAY, listing, put, run_at, transcript, video

DAMAGE = (b"", b"\xff\xfe", b"null", b"[]", b'{"a": 1}', b"[" * 100_000)


@pytest.mark.parametrize("data", DAMAGE, ids=["empty", "binary", "null", "list", "other", "deep"])
def test_a_damaged_list_of_keys_is_named_with_what_to_do(tmp_path: Path, data: bytes) -> None:
    path = Layout(tmp_path).purge("wiki")
    path.parent.mkdir()
    path.write_bytes(data)
    with pytest.raises(DamagedData, match=f"{path} can't be read: ") as error:
        purge.unfinished(tmp_path, "wiki")
    assert error.value.hint == "delete it, then run `kb purge wiki` again"


def test_a_dry_run_includes_what_an_interrupted_purge_left(tmp_path: Path) -> None:
    put(tmp_path, "videos", (MONDAY, {"id": "a,b,c"}, listing(video("a"), video("b"))))
    path = Layout(tmp_path).purge("youtube")
    path.parent.mkdir(exist_ok=True)
    path.write_text('{"keys": {"a": "named"}}')
    before = {file: file.read_bytes() for file in tmp_path.rglob("*") if file.is_file()}
    with dry_purge(
        run_at(tmp_path),
        CLASSES["youtube"].connector(run_at(tmp_path)),
        CLASSES["youtube"].purge_rules(),
        None,
    ) as dry:
        assert dry.keys == {"a": "named", "c": "vanished"}
        (line,) = purge.answers(dry)
    assert (line.folder, line.count) == ("raw/youtube/videos", 1)
    assert {file: file.read_bytes() for file in tmp_path.rglob("*") if file.is_file()} == before


VIDEO, OTHER, LISTED, ASKED, NEVER = (
    *("PotteryVi01", "PotteryVi02"),
    *("PotteryLi01", "PotteryAs01", "PotteryNe01"),
)


@pytest.fixture
def root(tmp_path: Path) -> Path:
    """Videos that were read, one with a transcript; one that only a channel's list names, and one
    that was asked for in vain.
    """
    root = tmp_path / "data"
    ids = f"{VIDEO},{OTHER},{ASKED}"
    put(root, "videos", (MONDAY, {"id": ids}, listing(video(VIDEO), video(OTHER))))
    put(root, "transcripts", transcript(VIDEO))
    entry = {"snippet": {"resourceId": {"videoId": LISTED}}, "contentDetails": {"videoId": LISTED}}
    put(root, "playlist_items", (MONDAY, {"playlistId": "UU1"}, listing(entry)))
    return root


@pytest.mark.parametrize("filtered", [False, True])
def test_each_id_of_youtube_is_told_apart(root: Path, filtered: bool) -> None:
    run = run_at(root)
    if filtered:
        run_clean(run, "youtube")
    lines = (
        f"https://www.youtube.com/watch?ab_channel=KilnRoad123&v={VIDEO}",
        VIDEO,
        LISTED,
        NEVER,
        "https://www.youtube.com/user/kilnroadpot",
        "KilnRoad",
    )
    # What was asked for in vain goes with every purge.
    assert purged(run, "youtube", *lines) == (2, 1, 0, 1, 2)
    assert tombstones.keys(root, "youtube") == {VIDEO, LISTED, ASKED, NEVER}
    assert purged(run, "youtube", *lines) == (0, 0, 3, 0, 2)
    assert purged(run, "youtube", OTHER, ASKED, NEVER) == (1, 0, 2, 0, 0)


def test_what_only_tables_hold_was_there(root: Path) -> None:
    run = run_at(root)
    run_clean(run, "youtube")
    for segment in root.glob("raw/youtube/*/*.zst"):
        segment.unlink()
    (root / "state" / "youtube.sqlite").unlink(missing_ok=True)
    with pytest.raises(FatalError, match="clean/youtube failed: nothing to filter") as error:
        purged(run, "youtube", VIDEO, LISTED, NEVER)
    assert [(error.value.summary or {})[name] for name in COUNTS] == [1, 0, 0, 2, 0]
    assert not list(root.glob("clean/**/*.parquet"))  # gone all the same


def test_a_list_that_names_no_item_changes_nothing(root: Path, tmp_path: Path) -> None:
    ids = tmp_path / "ids.txt"
    ids.write_text("\nhttps://vimeo.com/watch?v=PotteryVi01\nKilnRoad\n")
    before = sorted(root.rglob("*"))
    for command in ("purge", "plan"):
        with pytest.raises(SettingError, match=r"https://vimeo\.com/watch\?v=PotteryVi01") as error:
            Recipe("purge").defined(command)(run_at(root), "youtube", ids)
        assert error.value.exit_code == 2
    assert sorted(root.rglob("*")) == before


def test_unread_lines_are_listed_and_unknown_ids_are_one_line(
    root: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run = replace(run_at(root), progress=LineProgress())
    purged(run, "youtube", "KilnRoad", "PL0123", *(f"PotteryN{n:03}" for n in range(9)))
    said = capsys.readouterr().err.splitlines()
    assert [line for line in said if "KilnRoad" in line or "PL0123" in line] == [
        "unread, as it names no item: 'KilnRoad'",
        "unread, as it names no item: 'PL0123'",
    ] * 2
    assert len([line for line in said if "PotteryN" in line]) == 2  # of the plan and the purge


def test_an_interrupted_purge_says_in_the_end_what_it_would_have_said(
    root: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    purged(run_at(root), "youtube", OTHER)
    ids = tmp_path / "ids.txt"
    ids.write_text(f"{VIDEO}\n{OTHER}\n{NEVER}\n")
    room = Recipe("purge")

    def stop(*arguments: object) -> None:
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(purge, "finish", stop)
        with pytest.raises(KeyboardInterrupt):
            room.defined("purge")(run_at(root), "youtube", ids)
    assert Layout(root).purge("youtube").exists()
    for command in ("plan", "purge"):
        summary = room.defined(command)(run_at(root), "youtube", ids)
        assert [summary[name] for name in COUNTS] == [1, 0, 1, 1, 0]


keys = st.text(min_size=1, max_size=4) | st.sampled_from(["a", "é", 'q"', "b\\c", "7", "x/y", "\n"])


def envelope(asked: str, ids: list[Any]) -> Envelope:
    response = {"items": [{"id": one, "snippet": {"title": "t"}} for one in ids]}
    return Envelope("2026-01-01T00:00:00Z", Request("videos.list", {"id": asked}), 200, response)


@given(st.lists(keys, max_size=3), st.lists(keys | st.integers(0, 99), max_size=3), st.lists(keys))
@example(["é"], ["é"], ["é"])
@example([], [7], ["7"])
def test_no_answer_with_a_key_is_skipped(asked: list[str], ids: list[Any], gone: list[str]) -> None:
    made = envelope(",".join(asked), ids)
    _, line = rawlog.storable(made)
    kept = rawlog.decode(line)
    if strip_by_schema("youtube", "videos", kept, {"": set(gone)}) is not kept:
        assert Matcher(gone)(line)
        assert Matcher(gone)(json.dumps(json.loads(line)).encode())  # whatever else wrote it


@pytest.fixture
def segment(tmp_path: Path) -> Path:
    writer = rawlog.Segment(rawlog.folder(tmp_path, "youtube", "videos"))
    for number in range(60):
        ids = [f"v{number:03d}", f"w{number:03d}"]
        writer.append(rawlog.encode(envelope(",".join(ids), ids)))
    writer.close()
    (path,) = rawlog.segments(tmp_path, "youtube", "videos")
    return path


def test_only_answers_that_may_hold_a_key_are_decoded(segment: Path) -> None:
    seen: list[str] = []
    gone = {"v007", "v040", "w040"}

    def strip(one: Envelope) -> Envelope | None:
        seen.append(one.request.params["id"])
        return strip_by_schema("youtube", "videos", one, {"": gone})

    before = segment.read_bytes()
    frames = list(rawlog.Frames(segment))
    starts = [start for start, _, _ in changed_frames(segment, Matcher(gone), strip)]
    assert starts == [frames[6][0], frames[39][0]]
    assert seen == ["v007,w007", "v040,w040"]
    rewrite_segment(segment, starts, strip)
    left = [one for _, one in rawlog.Frames(segment)]
    lines = [line for _, line in frames]
    assert left == [
        *lines[:7],
        rawlog.encode(envelope("w007", ["w007"])),
        *lines[8:40],
        *lines[41:],
    ]
    # Frames without a key are the same bytes.
    assert segment.read_bytes().startswith(before[: frames[6][0]])
    assert segment.read_bytes().endswith(before[frames[40][0] :])
    assert not list(changed_frames(segment, Matcher(gone), strip))


@pytest.mark.parametrize("name", ["t1_ab", "t3_ab"])
def test_a_short_id_within_another_word_is_not_a_key(name: str) -> None:
    matches = Matcher(texts({name, "t1_abc"}))
    assert not matches(b'{"id":"abcd","link_id":"t3_xab","body":"cab, drab; xabc"}')
    for line in (
        b'{"id":"ab"}',
        b'"t3_ab"',
        b'"t1_x,t1_ab"',
        b'"abc"',
        b'"\\u0061b"',
        b'"abab","ab"',
    ):
        assert matches(line), line


POSTS = RowLocation("clean/reddit/posts", "reddit/posts", "post_id", "t3_")
LINKS = RowLocation("links", "links/links", "key", source="reddit")
ids = st.sampled_from(["a", "b", "c"])


@given(st.lists(ids), st.sets(ids))
def test_rows_match_by_prefix_and_source(values: list[str], keys: set[str]) -> None:
    rows = pa.RecordBatch.from_pydict({"post_id": pa.array(values, pa.string())})
    mask = POSTS.matches(rows, POSTS.values({f"t3_{key}" for key in keys} | {"t1_a"}))
    assert mask.to_pylist() == [value in keys for value in values]
    sources = ["reddit", "wiki"] * len(values)
    rows = pa.RecordBatch.from_pydict(
        {"key": pa.array(values * 2, pa.string()), "source": sources[: 2 * len(values)]}
    )
    mask = LINKS.matches(rows, LINKS.values(keys))
    assert [bool(one) for one in mask.to_pylist()] == [
        value in keys and source == "reddit"
        for value, source in zip(values * 2, sources, strict=False)
    ]


def test_a_dry_run_counts_and_changes_nothing(tmp_path: Path) -> None:
    path = tmp_path / "links" / "links-00000.parquet"
    path.parent.mkdir()
    pq.write_table(pa.table({"key": ["a", "b", "a"], "source": ["wiki", "reddit", "reddit"]}), path)
    before = path.read_bytes()
    lines = [("links", "links/links", 1)]
    assert list(drop_rows(tmp_path, [LINKS], ["a"], dry=True)) == lines
    assert list(drop_rows(tmp_path, [LINKS], ["c"])) == [("links", "links/links", 0)]
    assert path.read_bytes() == before


def test_tables_of_an_older_version_lack_columns(tmp_path: Path, make_rows: Any) -> None:
    path = tmp_path / "clean" / "youtube" / "rejected" / "part-00000.parquet"
    path.parent.mkdir(parents=True)
    rows = make_rows("shared/rejected", 3).drop_columns(["number", "other_stages"])
    pq.write_table(rows, path)
    key = rows["key"][0].as_py()
    location = RowLocation("clean/youtube/rejected", "shared/rejected", "key")
    lines = list(drop_rows(tmp_path, [location], [key]))
    assert lines == [("clean/youtube/rejected", "shared/rejected", 1)]
    kept = pq.read_table(path)
    assert kept.select(rows.column_names).to_pylist() == rows.slice(1).to_pylist()
    assert kept["number"].null_count == kept["other_stages"].null_count == 2


@pytest.mark.parametrize("how", ["empty", "cut"])
def test_a_damaged_table_is_not_an_empty_one(tmp_path: Path, how: str) -> None:
    path = tmp_path / "clean" / "reddit" / "posts" / "part-00000.parquet"
    path.parent.mkdir(parents=True)
    pq.write_table(pa.table({"post_id": ["a"] * 5_000}), path)
    path.write_bytes(b"" if how == "empty" else path.read_bytes()[:-9])
    with pytest.raises(DamagedData, match=f"{path} can't be read"):
        list(drop_rows(tmp_path, [POSTS], ["t3_a"]))
