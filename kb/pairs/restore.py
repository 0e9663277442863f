"""`kb pairs --from-index` and `kb restore`: a released index and transcripts → pairs with texts.

A text is cut out of its transcript by the released character positions. It counts when it has the
released number of tokens; a transcript that was edited since, or in another language, gives no
text.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast

import pyarrow as pa
import pyarrow.compute as pc

from kb.artifacts import domain_binding, manifest
from kb.artifacts.release_folder import ReleaseFolder
from kb.artifacts.restore import WantedContent
from kb.core import signals
from kb.core.config.profile.products import Pairs
from kb.core.context import Run
from kb.core.errors import SettingError
from kb.core.summary import Summary
from kb.core.summary.plan import PlanPart, PlanPhase
from kb.pairs import transcripts
from kb.pairs.clip_tokens import ENDS
from kb.pairs.extract import make_tools
from kb.pairs.keywords import Keywords
from kb.pairs.transcript_batch import without_sounds
from kb.pairs.transcripts import VIDEOS
from kb.schema.tables import conform, table
from kb.store.artifact_registry import ARTIFACTS
from kb.store.damage import opening
from kb.store.layout import Layout, parquet_files
from kb.store.lock import writer
from kb.store.state import tombstones
from kb.store.tables import parquet
from kb.store.tables.shard_writer import sorted_shards, write_table

DRAW = "draw"  # source of a folder of drawn pairs, and its table


def refill(run: Run, index: Path) -> Summary:
    """Write pairs/ with the index's rows; `text` is null where it can't be had, and counted.

    `index` is a released Parquet file or its folder. Holds the index in memory, transcripts a batch
    at a time. Raises SettingError, DamagedData, FatalError without transcripts.
    """
    files = transcripts.parts(run.root, index=index)
    rows = _read(index)
    with domain_binding.writing(run, "pairs"):
        folder = index if index.is_dir() else index.parent
        quality = sorted(folder.glob("quality-*.parquet"))
        return fill(run, rows, files, "pairs", quality)


@dataclass(frozen=True)
class TextRestore:
    """Texts of released pairs, cut out of restored transcripts into restored/pairs/, as a job of
    `kb restore`; without transcripts every text is null.
    """

    run: Run
    content: WantedContent
    left: Callable[[], Sequence[str]] = tuple  # the videos that are still to restore

    @property
    def wanted(self) -> bool:
        """Whether a folder of pairs, or a draw of them, was chosen."""
        return bool(self.content.folders_of("pairs") or self.content.folders_of(DRAW))

    @property
    def _indexes(self) -> list[ReleaseFolder]:
        """The folders of pairs: those that were chosen, else those beside a chosen draw."""
        beside = [one for one in self.content.folders if one.source == "pairs"]
        return self.content.folders_of("pairs") or (beside if self.content.folders_of(DRAW) else [])

    def check_settings(self, needed: tuple[str, ...]) -> tuple[str, ...]:
        """As `RestoreJob.check_settings`. Raises ProfileError without [pairs], SettingError."""
        if self.wanted:
            self.run.profile.section(Pairs)
        if self.wanted and not self._indexes:
            raise SettingError(
                "a draw alone has no times of its texts",
                hint="name the folder of pairs that it was drawn from as well",
            )
        if len(self._indexes) > 1:
            raise SettingError(
                "several folders contain pairs",
                hint="restore one index at a time, each into its own --data",
            )
        return needed

    def plan(self) -> PlanPart:
        """As `RestoreJob.plan`: pairs that have no row yet, or whose video is still to restore.
        Raises DamagedData.
        """
        items = 0
        restored = _ids(parquet_files(Layout(self.run.root).restored("pairs")), "pair_id")
        asked = pa.array(self.left(), pa.string())
        for folder in self._indexes:
            rows = _wanted(self.run.root, folder, self.content)
            done = pc.is_in(rows["pair_id"].cast(pa.string()), value_set=restored)
            waits = pc.is_in(rows["video_id"].cast(pa.string()), value_set=asked)
            items += pc.sum(pc.or_(pc.invert(done), waits)).as_py() or 0
        return PlanPart([PlanPhase("texts of pairs, out of the transcripts", items)])

    def restore(self) -> Summary:
        """As `RestoreJob.restore`; pairs of removed videos are left out. Raises DamagedData."""
        at, (folder,) = Layout(self.run.root), self._indexes
        transcripts = parquet_files(at.restored(VIDEOS, "transcripts"))
        rows = _wanted(self.run.root, folder, self.content)
        filled = fill(self.run, rows, transcripts, "restored/pairs")
        draws = self.content.folders_of(DRAW)
        if len(draws) == 1:
            _fill_draw(self.run.root, draws[0])
        elif draws:
            self.run.progress.say(
                f"{len(draws)} draws: the texts of their pairs are in restored.pairs; name one draw"
                " for a table of its own"
            )
        return filled

    def missing(self) -> pa.Table | None:
        """As `RestoreJob.missing`: pairs without text, and whether their video has a transcript."""
        at = Layout(self.run.root)
        transcripts = parquet_files(at.restored(VIDEOS, "transcripts"))
        videos = _ids(transcripts, "video_id")
        lists = []
        for path in parquet_files(at.restored("pairs")):
            rows = parquet.read_table(path, columns=["pair_id", "video_id", "text"])
            rows = rows.filter(pc.is_null(rows["text"]))
            known = pc.is_in(rows["video_id"].cast(pa.string()), value_set=videos)
            listed = {
                "source": pa.repeat("pairs", rows.num_rows),
                "part": pa.repeat("text", rows.num_rows),
                "key": rows["pair_id"].cast(pa.string()),
                "reason": pc.if_else(known, "other transcript", "no transcript"),
            }
            lists.append(pa.table(listed))
        return pa.concat_tables(lists) if lists else None


def _wanted(root: Path, folder: ReleaseFolder, content: WantedContent) -> pa.Table:
    """The rows of a released index without those of removed videos."""
    rows = _read(folder.path)
    own = tombstones.keys(root, VIDEOS)
    removed = pa.array(sorted(own | content.removed(VIDEOS, "pairs")), pa.string())
    purged = pc.is_in(rows["video_id"].cast(pa.string()), value_set=removed)
    rows = rows.filter(pc.invert(purged))
    if content.folders_of("pairs"):
        return rows
    drawn = _ids(
        [file for draw in content.folders_of(DRAW) for file in draw.shards(DRAW)], "pair_id"
    )
    return rows.filter(pc.is_in(rows["pair_id"].cast(pa.string()), value_set=drawn))


def _fill_draw(root: Path, folder: ReleaseFolder) -> None:
    """Write restored/draw: the rows of a draw with the texts of restored/pairs. Raises DamagedData,
    DiskFull.
    """
    files = parquet_files(Layout(root).restored("pairs"))
    pairs = pa.concat_tables(parquet.read_table(one, ["pair_id", "text"]) for one in files)
    rows = pa.concat_tables(parquet.read_table(one) for one in folder.shards(DRAW))
    ids = pairs["pair_id"].cast(pa.string()).combine_chunks()
    place = pc.index_in(rows["pair_id"].cast(pa.string()), value_set=ids)
    rows = rows.append_column("text", pairs["text"].take(place)).filter(pc.is_valid(place))
    rows = rows.sort_by([("split", "ascending"), ("rank", "ascending")])
    with manifest.replacing(root, f"restored/{DRAW}", inputs={}) as fresh:
        write_table(fresh.folder / "part-00000.parquet", rows, "draw/draw")


def _ids(files: Sequence[Path], name: str) -> pa.Array[Any]:
    columns = [parquet.read_table(path, columns=[name])[0] for path in files]
    chunks = [chunk for column in columns for chunk in column.cast(pa.string()).chunks]
    return pa.chunked_array(chunks, pa.string()).combine_chunks()


def fill(
    run: Run,
    rows: pa.Table,
    files: Sequence[Path],
    name: str,
    quality: Sequence[Path] = (),
) -> Summary:
    """Rows of an index with the texts of these transcripts, as the artifact `name`. `quality`: the
    released files of pairs/quality, which are taken as they are.
    """
    counter = make_tools(run.profile.section(Pairs), run.seed, Keywords((), (), ())).tokens
    places: dict[str, list[int]] = {}
    videos = cast("list[str]", rows["video_id"].to_pylist())
    for row, video in enumerate(videos):
        places.setdefault(video, []).append(row)
    texts: list[str | None] = [None] * rows.num_rows
    starts, ends, tokens = (
        rows[name].to_pylist() for name in ("text_start_char", "text_end_char", "token_count")
    )
    filled = differing = 0
    total = sum(transcripts.rows(path) for path in files)
    with (
        writer(run.root, "pairs"),
        run.progress.task("fill pairs", total, "transcripts") as task,
    ):
        for path in files:
            for batch in transcripts.texts(path):
                signals.stop.raise_if_asked()
                for number, video in enumerate(cast("list[str]", batch.ids.to_pylist())):
                    if video not in places:
                        continue
                    transcript = batch.transcript(number)
                    for row in places[video]:
                        spoken = without_sounds(transcript[starts[row] : ends[row]].encode())
                        text = " ".join(spoken.decode().split())
                        if counter.count(text) + ENDS == tokens[row]:
                            texts[row] = text
                            filled += 1
                        else:
                            differing += 1
                task.advance(len(batch), filled=filled)
        _write(run, rows.append_column("text", pa.array(texts, pa.string())), name, quality)
    return Summary(
        command="pairs",
        source="pairs",
        pairs=rows.num_rows,
        filled=filled,
        differing=differing,
        missing=rows.num_rows - filled - differing,
        path=str(ARTIFACTS[name].folder(run.root)),
    )


def _read(index: Path) -> pa.Table:
    files = sorted(index.glob("pairs-*.parquet")) if index.is_dir() else [index]
    if not files or not all(file.is_file() for file in files):
        raise SettingError(
            f"--from-index: there is no index at {index}",
            hint="give a released pairs-*.parquet or its folder",
        )
    schema = table("pairs/pairs").arrow(released=True)
    with opening(index, pa.ArrowInvalid):
        schemas = [parquet.footer(file).schema.to_arrow_schema() for file in files]
        lacking = [
            field.name
            for field in schema
            if not field.nullable and any(field.name not in schema.names for schema in schemas)
        ]
        if lacking:
            raise SettingError(
                f"--from-index: {index} is not an index of pairs: it has no column {lacking[0]!r}"
            )
        read = [
            parquet.read_table(file, columns=[name for name in schema.names if name in own.names])
            for file, own in zip(files, schemas, strict=True)
        ]
        rows = pa.concat_tables([schema.empty_table(), *read], promote_options="permissive")
    return conform("pairs/pairs", rows, released=True)


def _write(run: Run, rows: pa.Table, name: str, quality: Sequence[Path]) -> None:
    with manifest.replacing(run.root, name, inputs={}) as fresh:
        part = fresh.folder / ".filled.parquet"
        write_table(part, rows, "pairs/pairs")
        for table_, parts in (("pairs/pairs", [part]), ("pairs/quality", quality)):
            if parts:
                sorted_shards(parts, fresh.folder, table_, released=False)
        part.unlink()
        fresh.figures = {"complete": False}  # the next `kb pairs` makes its own
