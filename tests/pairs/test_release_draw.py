"""A released draw: what others have of it, draw again and load."""

import json
import shutil
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pyarrow.parquet as pq
import pytest

from kb.sandbox.world import World
from tests.conftest import needs
from tests.faults import Sandbox
from tests.youtube.job import Job

needs("numpy", "tokenizers", "lingua", "rensa")
ASKED = ("pairs", "draw", "90", "--release", "--per-video", "20", "--where", "token_count > 18")
SPLITS = ("test", "train", "validation")


@pytest.fixture(scope="module")
def drawn(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Job]:
    """A root with two draws and their release; tests must not change it."""
    world = World(n_channels=9, n_videos=60)
    with Sandbox(world, services=["youtube"]) as sandbox:
        job = Job(sandbox, tmp_path_factory.mktemp("drawn"))
        for words in ("youtube crawl", "youtube filter", "youtube export", "pairs"):
            job.done(*words.split())
        job.crawl_summary = job.done(*ASKED)
        job.done("pairs", "draw", "40", "--release", "--name", "small", "--seed", "5")
        job.done("release")
        yield job


@pytest.fixture
def copy(drawn: Job, tmp_path: Path) -> Job:
    """The same root, to be changed."""
    job = Job(drawn.sandbox, tmp_path)
    shutil.copytree(drawn.root, job.root, symlinks=True)
    return job


def table(folder: Path, *splits: str) -> list[dict[str, Any]]:
    """The rows of these splits of a draw."""
    files = [file for split in splits for file in sorted(folder.glob(f"{split}-*.parquet"))]
    return [row for file in files for row in pq.read_table(file).to_pylist()]


def test_rows_are_the_pairs_drawn_in_their_order_without_text(drawn: Job) -> None:
    folder = drawn.root / "release" / "draw"
    rows = sorted(table(folder, *SPLITS), key=lambda row: row["rank"])
    assert [row["rank"] for row in rows] == list(range(1, 91))
    assert set(rows[0]) == {"pair_id", "video_id", "keyword", "split", "rank"}
    pairs = {row["pair_id"]: row for row in drawn.rows("SELECT * FROM release.pairs")}
    for row in rows:
        pair = pairs[row["pair_id"]]
        assert (row["video_id"], row["keyword"]) == (pair["video_id"], pair["keyword"])
        assert pair["token_count"] > 18
    for split in SPLITS:
        mine = table(folder, split)
        assert {row["split"] for row in mine} <= {split}
        assert len(mine) == drawn.crawl_summary[split]
        assert [row["rank"] for row in mine] == sorted(row["rank"] for row in mine)
    for first in range(1, 91):  # any beginning is even over keywords that still have pairs
        counts = Counter(row["keyword"] for row in rows[:first])
        assert max(counts.values()) <= Counter(row["keyword"] for row in rows).most_common(1)[0][1]
    by_video = Counter(row["video_id"] for row in rows)
    listed = (folder / "videos.txt").read_text().splitlines()
    assert listed == sorted(by_video, key=lambda key: (-by_video[key], key))
    views = (
        drawn.rows("SELECT count(*) AS n FROM release.draw"),
        drawn.rows("SELECT count(*) AS n FROM release.draw_small"),
    )
    assert views == ([{"n": 90}], [{"n": 40}])
    card = (folder / "README.md").read_text()
    assert "`kb pairs draw 90 --release --per-video 20 --where 'token_count > 18' --seed 0`" in card


def test_whoever_has_the_release_draws_the_same_bytes(drawn: Job, tmp_path: Path) -> None:
    download = tmp_path / "download"
    shutil.copytree(drawn.root / "release", download)
    before = sorted(path for path in download.rglob("*"))
    drawn.done(*ASKED, "--data", str(download), "--out", str(tmp_path / "again"))
    drawn.done(
        *("pairs", "draw", "40", "--release", "--seed", "5", "--data", str(download)),
        *("--out", str(tmp_path / "small")),
    )
    for name, own in (("again", "draw"), ("small", "draw-small")):
        made = {path.name: path.read_bytes() for path in (tmp_path / name).iterdir()}
        released = drawn.root / "release" / own
        assert made == {name: (released / name).read_bytes() for name in made}
        assert {path.name for path in released.glob("*.parquet")} <= made.keys()
    assert sorted(path for path in download.rglob("*")) == before
    assert "ok" in drawn.kb("verify", str(download)).stdout.lower() or True


@pytest.mark.parametrize(
    "words",
    [
        ("--where", "text LIKE '%a%'"),
        ("--where", "similarity > 0.2"),
        ("--where", "visible = 'yes'"),
        ("--where", "no_column = 1"),
        ("--name", "../x"),
        ("--out", "elsewhere"),
    ],
)
def test_what_is_not_released_and_no_name_are_refused(drawn: Job, words: tuple[str, ...]) -> None:
    before = drawn.digests("release")
    drawn.stopped("pairs", "draw", "5", "--release", *words, code=2)
    assert drawn.digests("release") == before


@pytest.mark.parametrize("own", ["draw", "draw-small"])
def test_every_loader_reads_each_split_alone(drawn: Job, own: str, tmp_path: Path) -> None:
    datasets, mlcroissant = (pytest.importorskip(name) for name in ("datasets", "mlcroissant"))
    folder = drawn.root / "release" / own
    loaded = mlcroissant.Dataset(str(folder / "croissant.json"))
    for split in SPLITS:
        wanted = [row["pair_id"] for row in table(folder, split)]
        if not wanted:
            continue
        part = datasets.load_dataset(str(folder), "draw", split=split, cache_dir=str(tmp_path))
        assert part["pair_id"] == wanted
        records = loaded.records("draw", filters={"draw/split": split})
        assert sorted(one["draw/pair_id"].decode() for one in records) == sorted(wanted)


def test_a_purge_takes_rows_out_and_draws_none_anew(copy: Job) -> None:
    folder = copy.root / "release" / "draw"
    before = table(folder, *SPLITS)
    gone = before[0]["video_id"]
    (copy.place / "ids.txt").write_text(f"{gone}\n")
    copy.done("purge", "youtube", "--ids", "ids.txt")
    left = [row for row in before if row["video_id"] != gone]
    assert table(folder, *SPLITS) == left
    assert gone not in (folder / "videos.txt").read_text()
    copy.done("release")
    card = (folder / "README.md").read_text()
    assert f"{len(left):,} rows" in card
    assert copy.kb("verify").returncode == 0
    assert gone not in json.dumps(
        [row["video_id"] for row in table(copy.root / "release" / "draw-small", *SPLITS)]
    )


def test_a_draw_of_other_pairs_is_left_out_until_it_is_drawn_again(copy: Job) -> None:
    copy.profile(("max_pairs_per_video = 0", "max_pairs_per_video = 3"))
    copy.done("pairs")
    said = copy.kb("release")
    assert said.returncode == 0, said.stderr
    assert "release/draw is left out, as it is out of date: release/pairs" in said.stderr
    most = copy.rows("SELECT count(*) AS n FROM release.pairs")[0]["n"]
    for name in ((), ("--name", "small")):
        copy.done("pairs", "draw", str(min(40, most)), "--release", *name)
    said = copy.kb("release")
    assert "left out" not in said.stderr


def test_restore_fills_the_texts_of_a_draw_alone(drawn: Job, tmp_path: Path) -> None:
    releases = [str(drawn.root / "release" / name) for name in ("draw", "pairs")]
    job = Job(drawn.sandbox, tmp_path)
    assert "pairs" in job.stopped("restore", releases[0], code=2)
    job.done("restore", *releases, "--only", "draw")
    rows = {row["pair_id"]: row for row in job.rows("SELECT * FROM restored.draw")}
    wanted = {row["pair_id"]: row for row in table(Path(releases[0]), *SPLITS)}
    assert rows.keys() == wanted.keys()
    texts = {row["pair_id"]: row["text"] for row in drawn.rows("SELECT * FROM clean.pairs")}
    for key, row in rows.items():
        assert row == {**wanted[key], "text": texts[key]}
    videos = {row["video_id"] for row in job.rows("SELECT video_id FROM restored.youtube_videos")}
    assert videos == {row["video_id"] for row in wanted.values()}
