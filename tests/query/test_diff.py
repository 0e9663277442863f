"""Two roots or releases, row by row, each row against a count of its own."""

import json
import shutil
from collections.abc import Iterator
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import fsspec
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

import kb
from kb.store.tables.shard_writer import write_table
from tests import inprocess
from tests.cli.conftest import clean_environment


@pytest.fixture(scope="module")
def old(downloads: Path) -> Path:
    return downloads / "release"


@pytest.fixture(scope="module")
def new(old: Path, demo: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The maker's root after a change: videos that went, came and changed, with the reasons."""
    root = tmp_path_factory.mktemp("new") / "root"
    for name in ("clean", "pairs", "state"):
        shutil.copytree(demo / "data" / "demo" / name, root / name)
    (path,) = (root / "clean" / "youtube" / "videos").glob("*.parquet")
    rows = pq.read_table(path)
    videos = rows.slice(4).to_pylist()
    videos[0] |= {"view_count": videos[0]["view_count"] + 1}
    videos[1] |= {"fetched_at": datetime(2030, 1, 1, tzinfo=UTC)}  # read again, and the same
    videos.append({**videos[2], "video_id": "new-video-1"})
    videos.sort(key=lambda row: row["video_id"])
    write_table(path, pa.Table.from_pylist(videos, rows.schema), "youtube/videos")
    went = rows["video_id"].to_pylist()[:4]
    (path,) = (root / "clean" / "youtube" / "rejected").glob("*.parquet")
    known = pq.read_table(path)
    like = dict.fromkeys(known.column_names) | {"source": "youtube"}
    rejected = {"key": went[0], "stage": "views", "reason": "below", "value": "7"}
    more = [{**like, **rejected, "threshold": "100"}]
    both = pa.concat_tables([known, pa.Table.from_pylist(more, known.schema)]).sort_by("key")
    write_table(path, both, "shared/rejected")
    for verdict, row in (("failed", {"key": went[1], "reason": "500"}),):
        folder = root / "clean" / "youtube" / verdict
        shutil.rmtree(folder, ignore_errors=True)
        schema = pa.schema([("key", pa.string()), ("reason", pa.string())])
        folder.mkdir(parents=True)
        pq.write_table(pa.Table.from_pylist([row], schema), folder / "part-00000.parquet")
    from kb.store.state import tombstones

    tombstones.add_tombstones(root, "youtube", [(went[2], "named")])
    for manifest in root.rglob("_manifest.json"):
        manifest.unlink()
    return root


@pytest.fixture
def went(old: Path) -> list[str]:
    return [row["video_id"] for row in kb.load(old)["youtube_videos"][:4]]


def diff(place: Path, *words: object) -> Any:
    done = inprocess.run(["diff", *words], env=clean_environment(), cwd=place)
    assert done.code == 0, done.err
    return done.out


def rows(place: Path, *words: object) -> list[dict[str, Any]]:
    found: list[dict[str, Any]] = json.loads(diff(place, *words, "--format", "json"))
    return found


def test_a_line_a_table_with_the_three_numbers(old: Path, new: Path, tmp_path: Path) -> None:
    counts = {row["table"]: row for row in rows(tmp_path, old, new)}
    assert counts["youtube_videos"] == {
        "table": "youtube_videos",
        "came": 1,
        "went": 4,
        "changed": 1,
    }
    assert all(
        sum(counts[name][k] for k in ("came", "went", "changed")) == 0
        for name in ("wiki_pages", "reddit_posts", "reddit_comments", "pairs")
    )
    printed = diff(tmp_path, old, new).splitlines()
    assert printed[0].split() == ["table", "came", "went", "changed"]
    assert ["youtube_videos", "1", "4", "1"] in map(str.split, printed)


def test_each_row_with_the_reason_of_those_that_went(
    old: Path, new: Path, went: list[str], tmp_path: Path
) -> None:
    found = {row["key"]: row for row in rows(tmp_path, old, new, "--table", "youtube_videos")}
    none = dict.fromkeys(("stage", "reason", "value", "threshold"))
    assert found.pop("new-video-1") == {"key": "new-video-1", "change": "came", **none}
    why = [
        {"stage": "views", "reason": "below", "value": "7", "threshold": "100"},
        {**none, "stage": "failed", "reason": "500"},
        {**none, "stage": "removed", "reason": "named"},
        none,
    ]
    for key, reason in zip(went, why, strict=True):
        assert found.pop(key) == {"key": key, "change": "went", **reason}
    assert [row["change"] for row in found.values()] == ["changed"]


def test_the_same_the_other_way_round(old: Path, new: Path, tmp_path: Path) -> None:
    found = rows(tmp_path, new, old, "--table", "youtube_videos")
    assert sorted(row["change"] for row in found) == ["came"] * 4 + ["changed", "went"]
    assert not any(row["stage"] for row in found)


def test_a_row_of_a_video_that_went_has_its_reason(
    old: Path, new: Path, went: list[str], tmp_path: Path
) -> None:
    smaller = Path(shutil.copytree(new, tmp_path / "smaller"))
    for path in (smaller / "pairs").glob("pairs-*.parquet"):
        whole = pq.read_table(path)
        kept = [video not in went for video in whole["video_id"].to_pylist()]
        write_table(path, whole.filter(pa.array(kept)), "pairs/pairs")
    video_of = {row["pair_id"]: row["video_id"] for row in kb.load(old)["pairs"]}
    found = rows(tmp_path, old, smaller, "--table", "pairs")
    assert {row["change"] for row in found} == {"went"}
    assert {row["key"] for row in found} == {k for k, video in video_of.items() if video in went}
    stages = {video_of[row["key"]]: row["stage"] for row in found}
    told = dict(zip(went, ("views", "failed", "removed", None), strict=True))
    assert stages == {video: told[video] for video in stages}


def test_what_was_restored_is_what_was_released(downloads: Path, tmp_path: Path) -> None:
    counts = rows(tmp_path, downloads / "release", downloads / "release-restored")
    by_table = {row["table"]: (row["came"], row["went"], row["changed"]) for row in counts}
    assert {by_table[name] for name in ("youtube_videos", "reddit_posts", "pairs")} == {(0, 0, 0)}


@pytest.fixture
def memory(old: Path) -> Iterator[str]:
    system = fsspec.filesystem("memory")
    for source in ("youtube", "pairs"):
        system.put(f"{old}/{source}/", f"/lore/{source}/", recursive=True)
    yield "memory://lore"
    system.rm("/lore", recursive=True)


def test_both_sides_may_be_addresses(memory: str, old: Path, new: Path, tmp_path: Path) -> None:
    assert rows(tmp_path, memory, new, "--table", "youtube_videos") == rows(
        tmp_path, old, new, "--table", "youtube_videos"
    )
    counts = rows(tmp_path, memory, memory)
    youtube = {"youtube_videos", "youtube_playlists", "youtube_playlist_videos"}
    assert {row["table"] for row in counts} == {*youtube, "pairs", "pairs_quality"}
    assert not any(row["came"] or row["went"] or row["changed"] for row in counts)


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["{old}", "nowhere"], "there is no data root"),
        (["{old}", "{old}", "--table", "youtube_video"], "did you mean youtube_videos"),
        (["{old}", "{old}", "--out", "{old}/pairs/x.csv"], "is inside the download"),
    ],
)
def test_wrong_usage_is_exit_2(old: Path, tmp_path: Path, words: list[str], said: str) -> None:
    given = [word.format(old=old) for word in words]
    done = inprocess.run(["diff", *given], env=clean_environment(), cwd=tmp_path)
    assert (done.code, said in done.said) == (2, True), done.err


def test_authors_that_were_hashed_with_another_key_have_not_changed(
    demo: Path, downloads: Path, tmp_path: Path
) -> None:
    root, restored = demo / "data" / "demo", downloads / "release-restored"

    def changed(*sides: Path) -> tuple[list[int], str]:
        done = inprocess.run(["diff", *sides, "--json"], env=clean_environment(), cwd=tmp_path)
        by_table = {row["table"]: row["changed"] for row in json.loads(done.out)}
        return [by_table[name] for name in ("reddit_posts", "reddit_comments")], done.err

    counts, said = changed(root, restored)
    assert counts == [0, 0]
    assert "author_hash (hashed with another key)" in said
    assert "(one side has no values)" in said
    other = Path(shutil.copytree(root, tmp_path / "other"))  # one author of many is no other key
    (path,) = (other / "clean" / "reddit" / "posts").glob("*.parquet")
    posts = pq.read_table(path).to_pylist()
    next(row for row in posts if row["author_hash"])["author_hash"] = "0" * 32
    write_table(path, pa.Table.from_pylist(posts, pq.read_schema(path)), "reddit/posts")
    counts, said = changed(root, other)
    assert counts == [1, 0]
    assert "not compared" not in said
