"""`kb pairs --from-index`: a released index and one's own transcripts → pairs/*.parquet with text.

A text is cut out of the transcript by its released character positions and taken when it has the
released number of tokens; another transcript (edited since, another language) gives none. Releases
of earlier versions counted sounds ([Music]) as words of a text.
"""

from __future__ import annotations

import json
from collections.abc import Collection, Sequence
from pathlib import Path
from typing import cast

import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq

from kb.artifacts import belonging, manifest
from kb.core import signals
from kb.core.context import Run
from kb.core.errors import DamagedData, SettingError
from kb.core.plan import PlanPart, PlanPhase
from kb.core.profile.pairs import Pairs
from kb.core.verdict import Summary
from kb.pairs import transcripts
from kb.pairs.clip_tokens import ENDS
from kb.pairs.extract import make_tools
from kb.pairs.keywords import Keywords
from kb.pairs.transcript_batch import Text, without_sounds
from kb.schema.conform import conform
from kb.schema.tables import table
from kb.store import parquet, tombstones
from kb.store.atomic import replacing_folder, write_text
from kb.store.layout import Layout, parquet_files
from kb.store.lock import writer
from kb.store.reading import reading
from kb.store.shards import sorted_shards, write_table


def refill(run: Run, index: Path) -> Summary:
    """Write pairs/ with the index's rows; `text` is null where it can't be had, and counted.

    `index` is a released Parquet file or its folder. Holds the index in memory, transcripts a batch
    at a time. Raises SettingError, DamagedData, FatalError without transcripts.
    """
    files = transcripts.parts(run.root, index=index)
    rows = _read(index)
    with belonging.writing(run, "pairs"):
        return fill(run, rows, files, Layout(run.root).pairs)


def check(run: Run, indexes: Sequence[Path]) -> None:
    """Whether these can be restored into one data root. Raises SettingError."""
    if indexes:
        run.profile.section(Pairs)
    if len(indexes) > 1:
        raise SettingError(
            "several folders of pairs", hint="restore one index at a time, each into its --data"
        )


def plan(indexes: Sequence[Path]) -> PlanPart:
    """Texts that would be filled in. Raises DamagedData."""
    if not indexes:
        return PlanPart()
    files = [path for index in indexes for path in sorted(index.glob("pairs-*-of-*.parquet"))]
    with reading(files):
        rows = sum(pq.read_metadata(path).num_rows for path in files)
    return PlanPart([PlanPhase("texts of pairs, out of the transcripts", rows)])


def restore(run: Run, index: Path, removed: Collection[str]) -> Summary:
    """The same from restored transcripts into restored/pairs/, without pairs of `removed` videos.

    Without transcripts every text is null. Raises SettingError, DamagedData.
    """
    rows, at = _read(index), Layout(run.root)
    gone = pa.array(sorted({*removed, *tombstones.keys(run.root, "youtube")}), pa.string())
    rows = rows.filter(pc.invert(pc.is_in(rows["video_id"].cast(pa.string()), value_set=gone)))
    files = parquet_files(at.restored("youtube", "transcripts"))
    return fill(run, rows, files, at.restored("pairs"))


def fill(run: Run, rows: pa.Table, files: Sequence[Path], out: Path) -> Summary:
    """Rows of an index with the texts of these transcripts → `out`."""
    counter = make_tools(run.profile.section(Pairs), run.seed, Keywords((), (), ())).tokens
    places: dict[str, list[int]] = {}
    videos = cast("list[str]", rows["video_id"].to_pylist())
    for row, video in enumerate(videos):
        places.setdefault(video, []).append(row)
    texts: list[str | None] = [None] * rows.num_rows
    starts, ends, tokens = (
        rows[name].to_pylist() for name in ("text_start_char", "text_end_char", "token_count")
    )
    found = differing = 0
    total = sum(transcripts.rows(path) for path in files)
    with (
        writer(run.root, "pairs"),
        run.progress.task("fill pairs", total, "transcripts") as task,
    ):
        for path in files:
            for batch in transcripts.texts(path):
                signals.stop.check()
                for video, whole in _wanted(batch, places):
                    for row in places[video]:
                        for text in _readings(whole[starts[row] : ends[row]]):
                            if counter.count(text) + ENDS == tokens[row]:
                                texts[row] = text
                                found += 1
                                break
                        else:
                            differing += 1
                task.advance(len(batch), filled=found)
        _write(run, rows, texts, out)
    return Summary(
        command="pairs",
        source="pairs",
        pairs=rows.num_rows,
        filled=found,
        differing=differing,
        missing=rows.num_rows - found - differing,
        path=str(out),
    )


def _read(index: Path) -> pa.Table:
    files = sorted(index.glob("pairs-*.parquet")) if index.is_dir() else [index]
    if not files or not all(file.is_file() for file in files):
        raise SettingError(
            f"--from-index: there is no index at {index}",
            hint="give a released pairs-*.parquet or its folder",
        )
    names = table("pairs/pairs").names(released=True)
    try:
        schemas = [pq.read_schema(file) for file in files]
        lacking = [name for name in names if any(name not in schema.names for schema in schemas)]
        if lacking:
            raise SettingError(
                f"--from-index: {index} is no index of pairs, it has no column {lacking[0]!r}"
            )
        rows = pa.concat_tables(parquet.read_table(file, columns=names) for file in files)
    except (pa.ArrowInvalid, OSError) as error:
        raise DamagedData(
            f"the index {index} can't be read: {str(error).splitlines()[0]}"
        ) from None
    return conform("pairs/pairs", rows, released=True)


def _wanted(batch: Text, places: dict[str, list[int]]) -> list[tuple[str, str]]:
    """Ids and whole texts of the transcripts that the index names, sounds among them."""
    return [
        (video, batch.given[batch.video_at[row] : batch.video_end[row]].decode("utf-8", "replace"))
        for row, video in enumerate(batch.ids.to_pylist())
        if video in places
    ]


def _readings(captions: str) -> list[str]:
    """A part of a transcript as a text, without its sounds and with them."""
    spoken = without_sounds(captions.encode()).decode()
    return [" ".join(text.split()) for text in dict.fromkeys((spoken, captions))]


def _write(run: Run, rows: pa.Table, texts: list[str | None], out: Path) -> None:
    with replacing_folder(out) as fresh:
        part = fresh / ".filled.parquet"
        write_table(part, rows.append_column("text", pa.array(texts, pa.string())), "pairs/pairs")
        sorted_shards(
            [part],
            fresh,
            "pairs/pairs",
            rows_per_shard=run.profile.release.rows_per_shard,
            released=False,
        )
        part.unlink()
        note = {"fingerprint": "index", "complete": False}
        write_text(fresh / manifest.SUMMARY, json.dumps(note) + "\n")
