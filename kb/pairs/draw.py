"""A seeded draw of N pairs, spread evenly over keywords, with a split for training.

Of each keyword all pairs are drawn up to a common number, which is as high as N allows; within a
keyword they are spread evenly over its videos. Limits by video come first: a video that has too
many pairs gives those of its rarest keywords. The split keeps on one side a channel, videos that
say nearly the same, and videos of which two drawn clips show the same.

<out>/pairs.parquet    columns of pairs and quality, and `split`
<out>/videos.txt       ids of the videos, one a line, those with the most pairs first
<out>/README.md        what was drawn: keywords, limits, hours
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, cast

import duckdb
import pyarrow as pa
import pyarrow.parquet as pq

from kb.artifacts import freshness, table_catalog
from kb.core.context import Run
from kb.core.errors import UsageError
from kb.core.installation import np
from kb.core.summary import Summary
from kb.pairs import seeded_random
from kb.pairs.pair_selection import FIGURES, LABELS, SCORES, asking, checked
from kb.pairs.seeded_random import mixed
from kb.store.atomic import replacing_folder
from kb.store.tables import database, parquet
from kb.store.tables.reading import reading, scan

if TYPE_CHECKING:
    from kb.artifacts.table_catalog import Catalog

PAIRS, VIDEOS, README = "pairs.parquet", "videos.txt", "README.md"
SPLIT = {"test": 0.05, "validation": 0.05, "train": 0.9}
_TOLERATED = 0.02  # that a side's share of the pairs may differ without a word
_MEMORY = "250MB"  # of DuckDB, which spills what is more
_NUMBER = "('0x' || pair_id)::UBIGINT"


class Limits(NamedTuple):
    """What at most is drawn of a keyword and of a video, and of how many videos; 0: no limit."""

    per_keyword: int = 0
    per_video: int = 0
    videos: int = 0

    @property
    def in_words(self) -> str:
        """All of them as a sentence's part."""
        named = {
            "pairs of a keyword": self.per_keyword,
            "pairs of a video": self.per_video,
            "videos": self.videos,
        }
        limited = (f"at most {value:,} {name}" for name, value in named.items() if value)
        return ", ".join(limited) or "none"


class Pool(NamedTuple):
    """What pairs are drawn from, a row each: 64 random bits, keyword and video by number (int32),
    seconds of the clip; and the names of the keywords and videos.
    """

    id: np.ndarray
    keyword: np.ndarray
    video: np.ndarray
    seconds: np.ndarray
    keywords: list[str]
    videos: list[str]

    def take(self, rows: np.ndarray) -> Pool:
        """Some of the rows."""
        id_, keyword, video, seconds = (column[rows] for column in self[:4])
        return Pool(id_, keyword, video, seconds, self.keywords, self.videos)


def chosen_rows(pool: Pool, n: int, limits: Limits, seed: int) -> np.ndarray:
    """The rows of `n` drawn pairs in the order drawn: the first ones are as even over keywords as
    all of them. Raises UsageError with the largest number that can be drawn.
    """
    rows = np.arange(len(pool.id))
    rank = mixed(pool.id ^ mixed(np.array([seed], np.int64).astype(np.uint64)))
    available = np.bincount(pool.keyword, minlength=len(pool.keywords))
    if limits.videos:
        # A pair is worth the more the rarer its keyword is.
        worth = np.bincount(pool.video, 1 / available[pool.keyword], len(pool.videos))
        best = np.argsort(-worth, kind="stable")[: limits.videos]
        rows = np.flatnonzero(np.isin(pool.video, best))
    if limits.per_video:
        rarest = available[pool.keyword[rows]]
        rows = rows[np.lexsort((rank[rows], rarest, pool.video[rows]))]
        rows = rows[_places(pool.video[rows]) < limits.per_video]
    offered = np.bincount(pool.keyword[rows], minlength=len(pool.keywords))
    if limits.per_keyword:
        offered = np.minimum(offered, limits.per_keyword)
    if n > (most := int(offered.sum())):
        raise UsageError(
            f"{n:,} pairs can't be drawn: at most {most:,}",
            hint=f"draw {most}, or loosen the condition and the limits",
        )
    mixed_keywords = seeded_random.video_keys(seed, pool.keywords)
    quota = _quota(offered, n, mixed_keywords)
    order = rows[np.argsort(pool.keyword[rows], kind="stable")]
    del rows
    ends = np.searchsorted(pool.keyword[order], np.arange(len(quota)), "right").tolist()
    chosen = []
    for keyword, end in enumerate(ends):
        mine = order[ends[keyword - 1] if keyword else 0 : end]
        mine = mine[np.lexsort((rank[mine], pool.video[mine]))]
        # In the first turn each video gives one pair, in the second one more.
        turn = _places(pool.video[mine])
        chosen.append(mine[np.lexsort((rank[mine], turn))[: quota[keyword]]])
    order = np.concatenate(chosen)
    # The first pair of each keyword, then the second ones …, each time in the keywords' own order.
    turns = np.concatenate([np.arange(len(rows)) for rows in chosen])
    return order[np.lexsort((mixed_keywords[pool.keyword[order]], turns))]


def _places(groups: np.ndarray) -> np.ndarray:
    """The place of each row in its group; equal groups stand side by side."""
    number, new = np.arange(len(groups)), np.ones(len(groups), bool)
    new[1:] = groups[1:] != groups[:-1]
    return number - np.maximum.accumulate(np.where(new, number, 0))


def _quota(offered: np.ndarray, n: int, drawn: np.ndarray) -> np.ndarray:
    """How many pairs each keyword gives: all it has up to a common number, so that they are `n`.
    `drawn`: random bits of each keyword, which say whose turn it is when the last are given out.
    """
    low, high = 0, int(offered.max(initial=0))
    while low < high:  # the highest level that gives no more than n
        level = (low + high + 1) // 2
        low, high = (level, high) if np.minimum(offered, level).sum() <= n else (low, level - 1)
    quota = np.minimum(offered, low)
    more = np.flatnonzero(offered > low)
    quota[more[np.argsort(drawn[more], kind="stable")[: n - int(quota.sum())]]] += 1
    return quota


def sides_of(weights: np.ndarray, groups: np.ndarray, drawn: np.ndarray) -> np.ndarray:
    """The side of each video, as its place in SPLIT: whole groups in random order, each to the
    first side that has room for it, the last side for the rest.

    `weights`: pairs of each video; `groups`: its group's number; `drawn`: random bits of each
    group. With three groups or more no side is empty.
    """
    size = np.bincount(groups, weights, len(drawn)).astype(np.int64)
    room = [int(size.sum() * share) for share in SPLIT.values()]
    last = len(room) - 1
    side = np.full(len(drawn), last)
    order = [group for group in np.argsort(drawn, kind="stable").tolist() if size[group]]
    for group in order:
        fits = (place for place in range(last) if size[group] <= room[place])
        side[group] = chosen = next(fits, last)
        room[chosen] -= int(size[group])
    for small in range(last):  # what is left to fill, by the group that leaves least
        while len(free := [group for group in order if side[group] == last]) > 1:
            best = min(free, key=lambda group: abs(room[small] - size[group]))
            if abs(room[small] - size[best]) >= room[small] and (side[order] == small).any():
                break
            side[best] = small
            room[small] -= int(size[best])
    return side[groups]


class Asked(NamedTuple):
    """What is to be drawn: `n` pairs that meet the condition `where`. `aligned`: only those that
    are alignable at least so much, with their aligned times.
    """

    n: int
    limits: Limits = Limits()
    where: str = ""
    seed: int = 0
    aligned: float | None = None


class Draw(NamedTuple):
    """Drawn pairs in the order drawn, the side of each of their videos by its number as the place
    in SPLIT, what the summary says of them, and what a reader must know of the split.
    """

    pairs: Pool
    sides: np.ndarray
    summary: Summary
    remarks: list[str]

    def write_videos(self, path: Path) -> None:
        """The ids of the videos, those with the most pairs first."""
        names, counts = self.pairs.videos, np.bincount(self.pairs.video)
        order = sorted(np.flatnonzero(counts), key=lambda video: (-counts[video], names[video]))
        path.write_text("".join(f"{names[video]}\n" for video in order))

    @property
    def of_keywords(self) -> list[tuple[str, int]]:
        """How many pairs of which keyword were drawn."""
        counts = np.bincount(self.pairs.keyword, minlength=len(self.pairs.keywords)).tolist()
        return [pair for pair in zip(self.pairs.keywords, counts, strict=True) if pair[1]]


def draw(run: Run, asked: Asked, out: Path, *, plan: bool = False) -> Summary:
    """Draw pairs and write them to `out`, or only say what would be drawn.

    The same tables, condition and seed give the same bytes. Raises UsageError for a condition that
    can't be asked and for more pairs than there are, FatalError without pairs, DamagedData,
    DiskFull.
    """
    freshness.refuse(run, "pairs")
    place = table_catalog.outside(run.root, out)
    if not plan and place.exists() and not (place / PAIRS).is_file():
        raise UsageError(f"--out {out} exists and is not a draw of pairs", hint="name a new folder")
    catalog = table_catalog.read_catalog(run.root)
    every = asking(catalog, aligned=asked.aligned)
    with (
        reading(catalog.files("pairs/pairs")),
        database.connect(catalog.spill, memory=_MEMORY) as con,
    ):
        made = drawn_from(run, con, catalog, asked)
        if plan:
            return made.summary
        with replacing_folder(place) as folder:
            _write_pairs(con, every, made.pairs, made.sides, folder / PAIRS)
            made.write_videos(folder / VIDEOS)
            (folder / README).write_text(_readme(made, asked), encoding="utf-8")
    return Summary(made.summary, path=str(place))


def drawn_from(run: Run, con: duckdb.DuckDBPyConnection, catalog: Catalog, asked: Asked) -> Draw:
    """A draw from the pairs of a catalog. Raises as `draw`."""
    bare = f"FROM {scan(catalog.files('pairs/pairs'))}"  # without a condition no join
    if asked.where or asked.aligned is not None:
        sql = asking(catalog, where=asked.where, aligned=asked.aligned)
        bare = f"FROM ({checked(con, sql, asked.where)}) WHERE clip_start_s IS NOT NULL"
    pool = _pool(con, bare)
    drawn = pool.take(chosen_rows(pool, asked.n, asked.limits, asked.seed))
    out_of = len(pool.id)
    del pool  # of millions of pairs, while the drawn ones are written
    sides, groups = _sides(con, catalog, drawn, asked.seed)
    counts = Counter(np.array(list(SPLIT))[sides[drawn.video]].tolist())
    of_keyword = np.bincount(drawn.keyword, minlength=len(drawn.keywords))
    summary = Summary(
        command="pairs draw",
        pairs=len(drawn.id),
        out_of=out_of,
        keywords=int((of_keyword > 0).sum()),
        most_of_a_keyword=int(of_keyword.max(initial=0)),
        videos=len(np.unique(drawn.video)),
        hours=round(float(drawn.seconds.sum()) / 3600, 2),
        **{side: counts[side] for side in ("train", "validation", "test")},
    )
    remarks = split_remarks(summary, groups)
    for remark in remarks:
        run.progress.say(remark)
    return Draw(drawn, sides, summary, remarks)


def _pool(con: duckdb.DuckDBPyConnection, asked: str) -> Pool:
    """The pairs that are asked for, by id."""
    id_: list[np.ndarray] = [np.zeros(0, np.uint64)]
    seconds = [np.zeros(0, np.float32)]
    codes: dict[str, list[np.ndarray]] = {"keyword": [], "video_id": []}
    known: dict[str, dict[str, int]] = {name: {} for name in codes}
    sql = (
        f"SELECT {_NUMBER} AS id, keyword::VARCHAR AS keyword, video_id,"
        f" (clip_end_s - clip_start_s)::FLOAT AS seconds FROM ({asked})"
    )
    for batch in con.sql(sql).to_arrow_reader(1 << 17):
        # Copies: a view would keep the batch with all its strings.
        id_.append(batch.column("id").to_numpy().copy())
        seconds.append(batch.column("seconds").to_numpy().copy())
        for name, numbers in known.items():
            column = cast("Any", batch.column(name).dictionary_encode())
            own = [numbers.setdefault(v, len(numbers)) for v in column.dictionary.to_pylist()]
            codes[name].append(np.array(own, np.int32)[column.indices.to_numpy()])
    every, lengths = np.concatenate(id_), np.concatenate(seconds)
    id_.clear()
    seconds.clear()
    order = np.argsort(every)  # whatever the order of reading
    every = every[order]
    columns: list[np.ndarray] = []
    names: list[list[str]] = []
    for name, numbers in known.items():
        listed = sorted(numbers)
        place = np.zeros(len(listed), np.int32)
        place[[numbers[name] for name in listed]] = np.arange(len(listed))
        read = np.concatenate([np.zeros(0, np.int32), *codes.pop(name)])
        columns.append(place[read[order]] if len(read) else read)
        names.append(listed)
    (keyword, video), (keywords, videos) = columns, names
    return Pool(every, keyword, video, lengths[order], keywords, videos)


def _sides(
    con: duckdb.DuckDBPyConnection, catalog: Catalog, drawn: Pool, seed: int
) -> tuple[np.ndarray, int]:
    """The side of each video by its number, and how many groups the drawn pairs are of."""
    number = {name: place for place, name in enumerate(drawn.videos)}
    first = list(range(len(number)))

    def head(video: int) -> int:
        while first[video] != video:
            first[video] = first[first[video]]
            video = first[video]
        return video

    links: list[tuple[str, str]] = []
    if "youtube_videos" in (views := table_catalog.bare(catalog.views)):
        files = views["youtube_videos"].files
        with reading(files):
            links += con.execute(
                f"SELECT min(video_id) OVER (PARTITION BY channel_id), video_id"
                f" FROM {scan(files)} WHERE channel_id IS NOT NULL"
            ).fetchall()
    if quality := catalog.files("pairs/quality"):
        links += con.execute(
            f"SELECT DISTINCT duplicate_video_id, video_id FROM {scan(quality)}"
            " WHERE duplicate_video_id IS NOT NULL"
        ).fetchall()
    figures = catalog.files("films/film_figures")
    if figures and "visual_duplicate_of" in parquet.names(figures[0]):  # not by version 0.1
        con.register("chosen", pa.table({"id": pa.array(drawn.id)}))
        cluster = "PARTITION BY coalesce(visual_duplicate_of, pair_id)"
        links += con.execute(
            f"SELECT DISTINCT min(video_id) OVER ({cluster}), video_id FROM {scan(figures)}"
            f" SEMI JOIN chosen ON id = {_NUMBER}"
        ).fetchall()
    for pair in links:
        first_video, other_video = (number.setdefault(name, len(number)) for name in pair)
        first += range(len(first), len(number))
        low, high = sorted((head(first_video), head(other_video)))
        first[high] = low
    weights = np.bincount(drawn.video, minlength=len(first))
    heads = np.array([head(video) for video in range(len(first))], np.int64)
    sides = sides_of(weights, heads, seeded_random.video_keys(seed, number))
    return sides, len(np.unique(heads[weights > 0]))


def split_remarks(counts: Mapping[str, int], groups: int) -> list[str]:
    """What a reader must know of a split: sides without a pair, else shares that miss SPLIT.

    `counts`: pairs of each side; `groups`: how many parts there were that no split may cut.
    """
    total = sum(counts[side] for side in SPLIT)
    sides = sorted(SPLIT, key=lambda side: (-SPLIT[side], side != "validation"))
    cause = (
        "a channel, and videos that say or show nearly the same, stay on one side, and these pairs"
        f" are of {groups:,} such group{'s' * (groups != 1)}"
    )
    remedy = "draw from more channels: more pairs, a looser --where, or a larger --max-videos"
    if empty := [side for side in sides if not counts[side]]:
        return [f"no pairs for {' and '.join(empty)}: {cause}; {remedy}"]
    shares = [counts[side] / total for side in sides]
    wanted = [SPLIT[side] for side in sides]
    # A single pair is not cut: what it makes of a small draw's shares is rounding.
    if np.allclose(shares, wanted, rtol=0, atol=max(_TOLERATED, 1 / total) + 1e-9):
        return []
    got, meant = (", ".join(f"{100 * part:.0f}" for part in of) for of in (shares, wanted))
    return [f"the split is {got} % and not {meant} %: {cause}; {remedy}"]


def _write_pairs(
    con: duckdb.DuckDBPyConnection, asked: str, drawn: Pool, sides: np.ndarray, path: Path
) -> None:
    """The drawn pairs by video and time."""
    split = pa.array(list(SPLIT)).take(pa.array(sides[drawn.video]))
    con.register("drawn", pa.table({"id": pa.array(drawn.id), "split": split}))
    columns = [str(row[0]) for row in con.sql(f"DESCRIBE {asked}").fetchall()]
    kept = [name for name in columns if name not in (*SCORES, *FIGURES, *LABELS)]
    rows = con.sql(
        f"SELECT {', '.join(kept)}, split FROM ({asked}) JOIN drawn ON drawn.id = {_NUMBER}"
        " ORDER BY video_id, clip_start_s, pair_id"
    ).to_arrow_reader(1 << 16)
    with pq.ParquetWriter(path, rows.schema, compression="zstd") as file:
        for batch in rows:
            file.write_batch(batch)


def _readme(made: Draw, asked: Asked) -> str:
    """What was drawn, and how to go on."""
    summary, where, limited = made.summary, asked.where, asked.limits.in_words
    most = sorted(made.of_keywords, key=lambda item: (-item[1], item[0]))
    rows = "\n".join(f"| {name} | {count:,} |" for name, count in most)
    condition = f", where `{where}`" if where else ""
    timed = ""
    if asked.aligned is not None:
        condition += f", at aligned times, with `alignable >= {asked.aligned:g}`"
        timed = f" --aligned --alignable {asked.aligned:g}"
    noted = "".join(f"\n**{text[0].upper()}{text[1:]}.**\n" for text in made.remarks)
    return f"""\
# A draw of {summary["pairs"]:,} pairs

Drawn from {summary["out_of"]:,} pairs with the seed {asked.seed}{condition}.
Limits: {limited}. They are {summary["hours"]:,} hours of {summary["videos"]:,} videos.

| split | pairs |
|---|---|
| train | {summary["train"]:,} |
| validation | {summary["validation"]:,} |
| test | {summary["test"]:,} |
{noted}
A channel is on one side of the split, and so are videos that say or show nearly the same.
`{VIDEOS}` lists the videos, those with the most pairs first. With their files in a folder,
`kb clips --pairs {PAIRS} --videos FOLDER{timed}` cuts the clips.

| keyword | pairs |
|---|---|
{rows}
"""
