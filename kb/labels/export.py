"""A sample of pairs or tasks as a project for Label Studio: config.xml, tasks.json, README.md.

The sample is stratified. Within a stratum rows are ordered by a hash of seed and id, and strata get
places in proportion to the square root of their size (Bankier's power allocation, 1988), at least
one each, so that rare kinds have figures of their own. Each row's weight is how many rows of the
table it stands for. A larger sample of the same seed begins with the smaller one.
"""

import math
from html import escape
from pathlib import Path
from typing import Any, NamedTuple

import msgspec
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq

from kb.artifacts import freshness, manifest, table_catalog
from kb.core.context import Run
from kb.core.errors import FatalError, UsageError
from kb.core.summary import Summary
from kb.core.templates import environment
from kb.labels import questions
from kb.labels.questions import Labeling, LabelQuestion
from kb.pairs import transcripts
from kb.pairs.pair_selection import with_ids
from kb.pairs.transcript_batch import Text
from kb.store.atomic import replacing_folder
from kb.store.layout import Layout
from kb.store.tables import database, parquet
from kb.store.tables.reading import reading, scan

CONFIG, TASKS, README = "config.xml", "tasks.json", "README.md"
_TEMPLATES = Path(__file__).with_name("templates")
TRANSCRIPTS = f"{transcripts.VIDEOS}/transcripts"
_LONGEST_S = 60  # of a clip that people watch before they judge
_AROUND = 200  # characters of the transcript before and after the text


def export(
    run: Run, labeling: Labeling, sample: int, seed: int, out: Path, pairs: Path | None = None
) -> Summary:
    """Write the project to `out`. The same tables and seed give the same bytes. `pairs`: a file
    with the ids of those that may be drawn.

    Raises UsageError for a folder that is no such project or inside the data, FatalError where
    there is nothing to judge, DamagedData, DiskFull.
    """
    place = table_catalog.outside(run.root, out)
    if place.exists() and not (place / CONFIG).is_file():
        raise UsageError(
            f"--out {out} exists and is not a labelling project", hint="name a new folder"
        )
    catalog = table_catalog.read_catalog(run.root)
    files = catalog.files(labeling.table)
    if not files:
        raise FatalError(
            f"there are no {labeling.kind}s to judge",
            hint=f"run `{labeling.command}` first",
        )
    freshness.refuse(run, f"{labeling.kind}s")
    has_text = "text" in parquet.open_file(files[0]).schema_arrow.names
    where = "text IS NOT NULL" if has_text else "true"
    if pairs is not None:
        where += f" AND pair_id IN (SELECT pair_id FROM {scan([with_ids(pairs)])})"
    rows = _drawn(catalog.spill, files, labeling, sample, seed, where)
    around = _surroundings(run.root, files, rows) if has_text and rows else {}
    videos = described(run.root, rows) if labeling is questions.TASKS else {}
    asked = [one for one in labeling.questions if has_text or not one.of_text]
    tasks = [{"data": _data(row, labeling, around, videos)} for row in rows]
    watched = (times[1] - times[0] if (times := _times(row, labeling)) else 0 for row in rows)
    seconds = sum(min(one, _LONGEST_S) + labeling.seconds for one in watched)
    _write(place, labeling, asked, tasks, round(seconds / 3600, 1))
    return Summary(
        command="label export",
        items=len(rows),
        strata=len({row["stratum"] for row in rows}),
        out_of=round(sum(row["weight"] for row in rows)),
        hours=round(seconds / 3600, 1),
        path=str(place),
    )


def _drawn(
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


def _surroundings(
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


def _times(row: dict[str, Any], labeling: Labeling) -> tuple[int, int] | None:
    """Whole seconds from which and up to which the player runs; None: the whole video."""
    start, end = row[labeling.start], row[labeling.end]
    return None if start is None or end is None else (math.floor(start), math.ceil(end))


def _data(
    row: dict[str, Any],
    labeling: Labeling,
    around: dict[str, tuple[str, str]],
    videos: dict[str, DescribedVideo],
) -> dict[str, Any]:
    """What Label Studio shows of an item, and what it gives back with the answers."""
    times = _times(row, labeling)
    before, after = around.get(row["item_id"], ("", ""))
    player = f"https://www.youtube.com/embed/{row['video_id']}?rel=0"
    if times:
        player += "&start={}&end={}".format(*times)
    text, subject = row.get("text") or "", row[labeling.subject]
    span = ", from {} to {} s".format(*times) if times else ""
    words = f"<p>{escape(before)} <b>{escape(text)}</b> {escape(after)}</p>" if text else ""
    own = {}
    if labeling is questions.TASKS:
        video = videos.get(row["video_id"], DescribedVideo())
        shown = (f"<b>{escape(video.title)}</b>", *map(escape, video.description.splitlines()))
        own["description"] = f"<p>{'<br>'.join(shown)}</p>"
    return {
        "item_id": row["item_id"],
        "kind": labeling.kind,
        "video_id": row["video_id"],
        labeling.subject: subject,
        "stratum": row["stratum"],
        "weight": round(row["weight"], 4),
        "clip": (
            f'<iframe width="560" height="315" src="{escape(player)}"'
            ' referrerpolicy="strict-origin-when-cross-origin" allowfullscreen></iframe>'
        ),
        "about": f"<p>{labeling.subject.capitalize()}: <b>{escape(subject)}</b>{span}</p>{words}",
        **own,
    }


def _write(
    place: Path,
    labeling: Labeling,
    questions: list[LabelQuestion],
    tasks: list[dict[str, Any]],
    hours: float,
) -> None:
    texts = environment(_TEMPLATES, {}, autoescape=False)
    values = {"labeling": labeling, "questions": questions, "tasks": len(tasks), "hours": hours}
    with replacing_folder(place) as folder:
        for name in (CONFIG, README):
            page = texts.get_template(f"{name}.jinja").render(values)
            (folder / name).write_text(page, encoding="utf-8")
        encoded = msgspec.json.format(msgspec.json.encode(tasks), indent=1)
        (folder / TASKS).write_bytes(encoded + b"\n")
