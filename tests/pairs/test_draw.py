"""Draws of pairs: even over keywords and videos, split without a leak."""

import shutil
from itertools import pairwise
from pathlib import Path

import duckdb
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from hypothesis import given
from hypothesis import strategies as st

from kb.core.config.profile import load_profile
from kb.core.config.settings import load_settings
from kb.core.context import Run
from kb.core.errors import UsageError
from kb.pairs.build import build
from kb.pairs.draw import SPLIT, Asked, Limits, Pool, chosen_rows, draw, sides_of, split_remarks
from kb.schema.tables import table
from kb.store.tables.shard_writer import write_table
from tests.conftest import needs
from tests.pairs.made import fill

needs("numpy", "tokenizers", "lingua", "rensa")


def pool_of(pairs: list[tuple[int, int]]) -> Pool:
    """Pairs of (keyword, video)."""
    keyword, video = (np.array([one[n] for one in pairs], np.int32) for n in (0, 1))
    ids = np.arange(len(pairs), dtype=np.uint64) * np.uint64(0x9E3779B97F4A7C15)
    names = [[f"{what}{n:02}" for n in range(10)] for what in "kv"]
    order = np.argsort(ids)
    seconds = np.full(len(pairs), 10, np.float32)
    return Pool(ids[order], keyword[order], video[order], seconds, *names)


POOLS = st.lists(st.tuples(st.integers(0, 9), st.integers(0, 9)), min_size=1, max_size=120)


@given(POOLS, st.data())
def test_keywords_have_a_common_level_and_videos_take_turns(
    pairs: list[tuple[int, int]], data: st.DataObject
) -> None:
    pool = pool_of(pairs)
    n, seed = data.draw(st.integers(1, len(pairs))), data.draw(st.integers(0, 3))
    rows = chosen_rows(pool, n, Limits(), seed)
    assert len(set(rows.tolist())) == n
    available = np.bincount(pool.keyword, minlength=10)
    drawn = np.bincount(pool.keyword[rows], minlength=10)
    level = int(drawn.max())
    assert all(
        got in (min(there, level), min(there, level - 1))
        for got, there in zip(drawn.tolist(), available.tolist(), strict=True)
    )
    for keyword in range(10):
        mine = np.bincount(pool.video[pool.keyword == keyword], minlength=10)
        taken = np.bincount(pool.video[rows][pool.keyword[rows] == keyword], minlength=10)
        turns = int(taken.max())
        assert all((taken == mine) | (taken >= turns - 1))
    assert sorted(rows.tolist()) == sorted(chosen_rows(pool, n, Limits(), seed).tolist())


@given(POOLS, st.integers(0, 3), st.integers(0, 3), st.integers(0, 5))
def test_limits_hold_and_what_is_too_much_says_how_much_there_is(
    pairs: list[tuple[int, int]], per_keyword: int, per_video: int, videos: int
) -> None:
    pool, limits = pool_of(pairs), Limits(per_keyword, per_video, videos)
    with pytest.raises(UsageError, match="at most") as error:
        chosen_rows(pool, len(pairs) + 1, limits, 0)
    most = int(str(error.value).rpartition(" ")[2])
    rows = chosen_rows(pool, most, limits, 0)
    assert len(rows) == most > 0
    assert not per_keyword or np.bincount(pool.keyword[rows]).max() <= per_keyword
    assert not per_video or np.bincount(pool.video[rows]).max() <= per_video
    assert not videos or len(set(pool.video[rows].tolist())) <= videos


@given(st.lists(st.tuples(st.integers(0, 30), st.integers(1, 9)), min_size=200, max_size=400))
def test_no_group_is_on_two_sides_and_shares_are_right(videos: list[tuple[int, int]]) -> None:
    groups = np.array([group for group, _ in videos] + list(range(40, 80)))
    weights = np.array([weight for _, weight in videos] + [1] * 40)
    bits = np.random.default_rng(len(videos)).integers(0, 1 << 62, 80).astype(np.uint64)
    sides = sides_of(weights, groups, bits)
    for group in set(groups.tolist()):
        assert len(set(sides[groups == group].tolist())) == 1
    shares = np.bincount(sides, weights, len(SPLIT)) / weights.sum()
    assert np.abs(shares - list(SPLIT.values())).max() <= 0.01


def test_three_large_channels_have_a_side_each() -> None:
    bits = np.array([3, 1, 2], np.uint64)
    assert sorted(sides_of(np.array([50, 40, 60]), np.arange(3), bits).tolist()) == [0, 1, 2]


@pytest.mark.parametrize(
    ("counts", "groups", "remark"),
    [
        ((90, 5, 5), 40, ""),
        ((89, 7, 4), 40, ""),
        ((46, 2, 2), 40, ""),  # as near as 50 pairs come
        ((17, 1, 1), 19, ""),
        ((17, 2, 1), 20, ""),
        ((15, 3, 1), 19, "the split is 79, 16, 5 % and not 90, 5, 5 %: "),
        ((9, 0, 0), 1, "no pairs for validation and test: "),
        ((8, 0, 1), 2, "no pairs for validation: "),
        ((60, 30, 10), 3, "the split is 60, 30, 10 % and not 90, 5, 5 %: "),
        ((87, 8, 5), 9, "the split is 87, 8, 5 % and not 90, 5, 5 %: "),
    ],
)
def test_a_split_that_is_not_as_promised_is_named_with_a_remedy(
    counts: tuple[int, int, int], groups: int, remark: str
) -> None:
    sides = dict(zip(("train", "validation", "test"), counts, strict=True))
    remarks = split_remarks(sides, groups)
    assert len(remarks) == bool(remark)
    for line in remarks:
        assert line.startswith(remark)
        assert f"are of {groups} such group" in line
        assert line.endswith(
            "draw from more channels: more pairs, a looser --where, or a larger --max-videos"
        )


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory, data, make_rows) -> Run:
    """Pairs of invented transcripts."""
    root = tmp_path_factory.mktemp("draw") / "data"
    fill(root, *data, make_rows)
    run = Run(load_settings(dotenv=False), load_profile("minecraft"), root, workers=1)
    build(run)
    return run


def test_a_draw_has_rows_videos_and_what_was_drawn(made: Run, tmp_path: Path) -> None:
    out = tmp_path / "draw"
    summary = draw(made, Asked(60, Limits(per_video=5), "token_count > 20", 3), out)
    rows = pq.read_table(out / "pairs.parquet")
    assert rows.num_rows == summary["pairs"] == 60
    [(missing,)] = duckdb.sql(
        f"SELECT count(*) FROM '{out}/pairs.parquet' AS d ANTI JOIN"
        f" '{made.root}/pairs/pairs-*.parquet' AS p USING (pair_id, text, clip_start_s)"
    ).fetchall()
    assert missing == 0
    assert {"duplicate_of", "recurring_share", "language", "split"} <= set(rows.column_names)
    assert min(rows["token_count"].to_pylist()) > 20
    listed = (out / "videos.txt").read_text().splitlines()
    counted = rows["video_id"].value_counts().to_pylist()
    ordered = sorted(counted, key=lambda one: (-one["counts"], one["values"]))
    assert listed == [one["values"] for one in ordered]
    assert ordered[0]["counts"] <= 5
    assert "at most 5 pairs of a video" in (out / "README.md").read_text()
    first = {path.name: path.read_bytes() for path in out.iterdir()}
    draw(made, Asked(60, Limits(per_video=5), "token_count > 20", 3), out)
    assert {path.name: path.read_bytes() for path in out.iterdir()} == first
    other = draw(made, Asked(60, Limits(per_video=5), "", 4), tmp_path / "other")
    assert other["pairs"] == 60
    assert (tmp_path / "other/pairs.parquet").read_bytes() != first["pairs.parquet"]


def test_channels_and_duplicates_stay_together(made: Run, tmp_path: Path) -> None:
    summary = draw(made, Asked(200, Limits(), "", 0), tmp_path / "draw")
    rows = duckdb.sql(
        f"""SELECT channel_id, duplicate_video_id, d.video_id, split
        FROM '{tmp_path}/draw/pairs.parquet' AS d
        JOIN '{made.root}/clean/youtube/videos/*.parquet' AS v USING (video_id)"""
    ).fetchall()
    side = {video: split for *_, video, split in rows}
    for channel in {one[0] for one in rows if one[0] is not None}:
        assert len({one[3] for one in rows if one[0] == channel}) == 1
    assert all(side.get(copy, split) == split for _, copy, _, split in rows if copy)
    assert summary["train"] + summary["validation"] + summary["test"] == 200


def test_drawn_clips_that_show_the_same_stay_together(made: Run, tmp_path: Path) -> None:
    """A chain through three videos of different channels; what is not drawn joins nothing."""
    root = Path(shutil.copytree(made.root, tmp_path / "data"))
    run = Run(made.settings, made.profile, root, workers=1)
    pairs = duckdb.sql(
        f"""SELECT pair_id, video_id FROM '{root}/pairs/pairs-*.parquet'
        JOIN '{root}/clean/youtube/videos/*.parquet' USING (video_id)
        QUALIFY row_number() OVER (PARTITION BY video_id ORDER BY pair_id) <= 2
            AND min(video_id) OVER (PARTITION BY channel_id) = video_id
        ORDER BY video_id, pair_id"""
    ).fetchall()
    videos = {video: [pair for pair, of in pairs if of == video] for _, video in pairs}
    chain = [own for own in videos.values() if len(own) == 2][:12]
    assert len(chain) == 12
    linked = {pair: None for own in chain for pair in own}
    linked |= {own[0]: before[1] for before, own in pairwise(chain)}
    rows = [
        {"pair_id": pair, "video_id": video, "visual_duplicate_of": linked.get(pair)}
        | {"cuts": 0, "cut_free_start_s": 0.0, "cut_free_end_s": 1.0}
        for pair, video in pairs
    ]
    name = "films/film_figures"
    write_table(
        root / "films" / "film_figures-00000-of-00001.parquet",
        pa.Table.from_pylist(rows, schema=table(name).arrow()),
        name,
    )
    [(every,)] = duckdb.sql(f"SELECT count(*) FROM '{root}/pairs/pairs-*.parquet'").fetchall()
    apart = 0
    for seed in range(3):
        draw(run, Asked(every, seed=seed), tmp_path / "draw")
        side = dict(
            duckdb.sql(f"SELECT video_id, split FROM '{tmp_path}/draw/pairs.parquet'").fetchall()
        )
        assert len({side[video] for video, own in videos.items() if own in chain}) == 1
        firsts = Asked(1, where="visual_duplicate_of IS NULL", seed=seed)
        with pytest.raises(UsageError, match="at most") as error:
            draw(run, firsts._replace(n=every + 1), tmp_path / "draw")
        most = int(str(error.value).rpartition(" ")[2].replace(",", ""))
        assert most == every - 11
        draw(run, firsts._replace(n=most), tmp_path / "draw")
        side = dict(
            duckdb.sql(f"SELECT video_id, split FROM '{tmp_path}/draw/pairs.parquet'").fetchall()
        )
        apart += len({side[video] for video, own in videos.items() if own in chain}) > 1
    assert apart


@pytest.mark.parametrize(
    ("where", "message", "hint"),
    [
        ("visible = 'yes'", "--where names visible", "`kb label import FILE`"),
        ("margin > 0", "--where names margin", "`kb pairs score --videos DIR`"),
        (
            "keyword = 'margin' AND nothing = 1",
            "is not a valid condition: Binder Error",
            "language = 'en'",
        ),
        ("token_count >", "is not a valid condition: Parser Error", "language = 'en'"),
        (
            "true); SELECT (true",
            "is not a valid condition: it is more than a condition",
            "language = 'en'",
        ),
    ],
)
def test_a_condition_that_cannot_be_met_says_why(
    made: Run, tmp_path: Path, where: str, message: str, hint: str
) -> None:
    with pytest.raises(UsageError) as error:
        draw(made, Asked(5, Limits(), where, 0), tmp_path / "draw")
    assert message in str(error.value)
    assert hint in error.value.hint
    assert not (tmp_path / "draw").exists()


def test_what_people_answered_is_a_column(made: Run, tmp_path: Path) -> None:
    ids = pq.read_table(made.root / "pairs" / "pairs-00000-of-00001.parquet")["pair_id"].to_pylist()
    rows = [(one, "pair", n, "visible", answer) for one, answers in
            ((ids[0], ("yes", "no", "yes")), (ids[1], ("no",)))
            for n, answer in enumerate(answers, 1)]  # fmt: skip
    names = ("item_id", "kind", "annotator", "question", "answer")
    (made.root / "labels").mkdir()
    pq.write_table(
        pa.table({name: [row[n] for row in rows] for n, name in enumerate(names)}),
        made.root / "labels/labels-00000-of-00001.parquet",
    )
    draw(made, Asked(1, Limits(), "visible = 'yes'", 0), tmp_path / "draw")
    assert pq.read_table(tmp_path / "draw/pairs.parquet")["pair_id"].to_pylist() == [ids[0]]


def test_a_draw_of_one_channel_says_what_it_lacks(made: Run, tmp_path: Path) -> None:
    [(first,)] = duckdb.sql(
        f"SELECT video_id FROM '{made.root}/pairs/pairs-*.parquet' LIMIT 1"
    ).fetchall()
    draw(made, Asked(2, Limits(), f"video_id = '{first}'", 0), tmp_path / "draw")
    lacks = "**No pairs for validation and test: a channel"
    assert lacks in (tmp_path / "draw" / "README.md").read_text(encoding="utf-8")


@pytest.mark.parametrize(
    ("where", "named"),
    [("langage = 'en'", "language"), ("token_cuont > 2", "token_count")],
)
def test_a_misspelled_column_of_a_condition_gets_the_candidates(
    made: Run, tmp_path: Path, where: str, named: str
) -> None:
    with pytest.raises(UsageError, match=rf'Candidate bindings: .*"{named}"'):
        draw(made, Asked(2, Limits(), where, 0), tmp_path / "draw")
