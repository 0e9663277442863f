"""The sample of pairs or tasks that people judge, and what they need to see of an item.

The sample is stratified. Within a stratum rows are ordered by a hash of seed and id, and strata get
places in proportion to the square root of their size (Bankier's power allocation, 1988), at least
one each, so that rare kinds have figures of their own. Each row's weight is how many rows of the
table it stands for. A larger sample of the same seed begins with the smaller one.
"""

import math
from pathlib import Path
from typing import Any, NamedTuple

import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq

from kb.artifacts import manifest
from kb.labels.questions import Labeling, LabelQuestion
from kb.pairs import transcripts
from kb.pairs.transcript_batch import Text
from kb.store.layout import Layout
from kb.store.tables import database, parquet
from kb.store.tables.reading import reading, scan

PLAYER = "https://www.youtube.com"
TRANSCRIPTS = f"{transcripts.VIDEOS}/transcripts"
_AROUND = 200  # characters of the transcript before and after the text


def drawn_rows(
    spill: Path | None, files: list[Path], labeling: Labeling, sample: int, seed: int, where: str
) -> list[dict[str, Any]]:
    """Rows of the sample, each with `item_id`, `stratum` and `weight`."""
    parquet.verify_files(*files)
    with reading(files), database.connect(spill) as con:
        drawn = con.sql(
            f"""
            WITH ranked AS (
                SELECT {labeling.key} AS item_id, {labeling.stratum} AS stratum,
                    md5($seed || ' ' || item_id) AS draw,
                    row_number() OVER (PARTITION BY stratum ORDER BY draw, item_id) AS place,
                    count(*) OVER (PARTITION BY stratum) AS size
                FROM {scan(files)} WHERE {where}),
            drawn AS (
                SELECT *, row_number() OVER (ORDER BY (place - 1) / sqrt(size), draw, item_id) AS n
                FROM ranked QUALIFY n <= $sample)
            SELECT item_id, stratum, size / count(*) OVER (PARTITION BY stratum) AS weight, rows.*
            FROM drawn JOIN {scan(files)} AS rows ON item_id = {labeling.key} ORDER BY n""",
            params={"seed": str(seed), "sample": sample},
        ).to_arrow_table()
    return drawn.to_pylist()


def surroundings(
    root: Path, files: list[Path], rows: list[dict[str, Any]]
) -> dict[str, tuple[str, str]]:
    """What is said before and after the texts of pairs, by item; {} without transcripts."""
    if files[0].parent != Layout(root).pairs or not manifest.rows(root, TRANSCRIPTS):
        return {}
    ids = pa.array(sorted({row["video_id"] for row in rows}))
    batch = Text(transcripts.of_videos(root, ids))
    spoken = {video: batch.transcript(n) for n, video in enumerate(batch.ids.to_pylist())}
    around = {}
    for row in rows:
        text, start = spoken.get(row["video_id"], ""), row["text_start_char"]
        before = text[max(start - _AROUND, 0) : start].partition(" ")[2]  # whole words
        after = text[row["text_end_char"] :][:_AROUND].rpartition(" ")[0]
        around[row["item_id"]] = before.strip(), after.strip()
    return around


class DescribedVideo(NamedTuple):
    """What its channel says of a video; empty where only a release is there."""

    title: str = ""
    description: str = ""
    channel: str = ""
    length_s: float | None = None


def described(root: Path, rows: list[dict[str, Any]]) -> dict[str, DescribedVideo]:
    """The videos of these rows, by id."""
    ids = pa.array(sorted({row["video_id"] for row in rows}), pa.string())
    files = manifest.rows(root, f"{transcripts.VIDEOS}/videos")
    columns = ("video_id", "title", "description", "channel_title", "duration_s")
    videos = {}
    for path in files:
        kept = pc.field("video_id").isin(ids)
        part = pq.read_table(path, columns=list(columns), filters=kept)
        for key, title, description, channel, length in zip(
            *(part[one].to_pylist() for one in columns), strict=True
        ):
            videos[key] = DescribedVideo(title or "", description or "", channel or "", length)
    return videos


def clip_times(row: dict[str, Any], labeling: Labeling) -> tuple[int, int] | None:
    """Whole seconds from which and up to which the player runs; None: the whole video."""
    start, end = row[labeling.start], row[labeling.end]
    return None if start is None or end is None else (math.floor(start), math.ceil(end))


def player_address(video_id: str, times: tuple[int, int] | None) -> str:
    """The page of the service's player, which runs from and to these seconds."""
    address = f"{PLAYER}/embed/{video_id}?rel=0"
    return address + ("&start={}&end={}".format(*times) if times else "")


def has_text(files: list[Path]) -> bool:
    """Whether these rows hold what is spoken, which those of a release do not."""
    return "text" in parquet.open_file(files[0]).schema_arrow.names


def asked_questions(
    labeling: Labeling, files: list[Path], *, aligned: bool = False
) -> list[LabelQuestion]:
    """The questions that can be asked about the rows of these files, of clips at spoken times or at
    aligned ones.
    """
    spoken = has_text(files)
    asked = (question for question in labeling.questions if question.aligned == aligned)
    return [question for question in asked if spoken or not question.of_text]


def at_aligned_times(
    spill: Path | None, figures: list[Path], rows: list[dict[str, Any]]
) -> list[dict[str, Any]]:
    """Rows of pairs with the times of `kb pairs align`. `figures`: files of films/film_figures."""
    with reading(figures), database.connect(spill) as con:
        con.register("sample", pa.table({"pair_id": [row["item_id"] for row in rows]}))
        times = con.sql(
            f"SELECT pair_id, aligned_start_s, aligned_end_s FROM {scan(figures)}"
            " SEMI JOIN sample USING (pair_id)"
        ).fetchall()
    aligned = {pair: {"clip_start_s": start, "clip_end_s": end} for pair, start, end in times}
    return [row | aligned[row["item_id"]] for row in rows]
