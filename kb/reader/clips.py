"""Clips: pairs with their videos and texts, as a table or as a PyTorch dataset."""

from __future__ import annotations

import os
from collections.abc import Iterable
from pathlib import Path
from typing import cast

import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq

from kb import query
from kb.artifacts.table_catalog import View
from kb.clips.clip_files import CutOptions
from kb.clips.clip_sources import ClipSource, Films, Shards
from kb.clips.frames import Fit
from kb.clips.torch_dataset import ClipDataset, torch_dataset
from kb.core.errors import UsageError
from kb.core.installation import require
from kb.core.sources import made_of
from kb.core.suggestions import did_you_mean, similar
from kb.reader.hints import with_hints
from kb.reader.tables import OpenTables, QueryResult, TableView
from kb.store.exhausted import is_out_of_memory
from kb.store.tables.reading import text_literal

Folder = str | os.PathLike[str]
_TRAINED = ("pair_id", "video_id", "keyword", "text", "clip_start_s", "clip_end_s", "duration_s")
_ALIGNED = ("aligned_start_s", "aligned_end_s", "alignable")
_OF_VIDEO = ("title", "duration_s", "view_count", "like_count", "published_at")


class Clips(QueryResult):
    """The clips that `kb.load(…).clips` found."""

    @with_hints
    def torch(
        self,
        videos: Folder | Iterable[Folder] | None = None,
        *,
        shards: Folder | None = None,
        frames: int = 16,
        size: tuple[int, int] = (160, 256),
        fit: Fit = "stretch",
        seed: int = 0,
        rank: int = 0,
        world_size: int = 1,
        aligned: bool = False,
        alignable: float = 0.0,
    ) -> ClipDataset:
        """A PyTorch dataset of these clips (torch.utils.data.IterableDataset), in random order.

            clips = data.clips("creeper").torch(videos="films")
            for batch in torch.utils.data.DataLoader(clips, batch_size=64, num_workers=4): …

        Decodes the user's own video files in the folders `videos`, found by id (ID.mp4, TITLE
        [ID].webm, ID/video.mkv) and taken if they are as long as the video, or reads `shards`, the
        folder that `kb clips --out` wrote. `size`: height and width in px. `aligned`: clips at the
        times that `kb pairs align` found, without those that are less than `alignable`.
        docs/train.md has a whole training loop.

        Raises MissingExtra, and UsageError for wrong arguments or where no clip has file and text.
        """
        require("torch", "torch", "av", "PIL", "tokenizers")
        if (videos is None) == (shards is None):
            raise UsageError("clips come from video files or from shards", hint="give one of them")
        if aligned and shards is not None:
            raise UsageError(
                "clips of shards have the times that they were cut at",
                hint="cut them with `kb clips --aligned`",
            )
        if frames < 1 or min(size) < 1:
            raise UsageError("frames, height and width are numbers above 0")
        options, rows = CutOptions(frames, size, fit), self._timed(aligned, alignable)
        source: ClipSource
        if shards is not None:
            source = Shards(Path(shards).absolute(), options)
        else:
            given = [videos] if isinstance(videos, str | os.PathLike) else videos or ()
            source = Films(
                [Path(folder).absolute() for folder in given],
                dict(
                    zip(*rows.select(["video_id", "duration_s"]).to_pydict().values(), strict=True)
                ),
                options,
            )
        return torch_dataset(rows, source, seed=seed, rank=rank, world_size=world_size)

    def _timed(self, aligned: bool, alignable: float) -> pa.Table:
        """What a dataset needs of each clip; without times where it is not alignable enough."""
        if not aligned:
            return self.to_table(_TRAINED)
        if "alignable" not in self.schema.names:
            raise UsageError("no pair is aligned yet", hint="run `kb pairs align` first")
        rows = self.to_table([*_TRAINED, *_ALIGNED])
        enough = pc.greater_equal(rows["alignable"], alignable)
        for side in ("start", "end"):
            times = pc.if_else(enough, rows[f"aligned_{side}_s"], None)
            place = rows.schema.get_field_index(f"clip_{side}_s")
            rows = rows.set_column(place, f"clip_{side}_s", times)
        return rows.select(_TRAINED)


def find(
    opened: OpenTables, keyword: str | None, where: str = "", drawn: Path | None = None
) -> Clips:
    """The clips of a keyword, in any case of its letters, or of all; by video and start.

    Columns: pair_id, keyword, keyword_kind, video_id, title and figures of the video, the clip's
    start and end (s), `url` that starts there, `text` (null where it was not restored),
    token_count, transcript_kind, timing, and the columns of pairs_quality and, where pairs were
    scored, of pairs_scores and film_figures. `where`: a condition on them in DuckDB's SQL; `drawn`:
    a file of `kb pairs draw`, whose `split` is a column then. Raises UsageError where there are no
    pairs, no such keyword, or the condition is wrong.
    """
    ranked = opened.ranked("pairs")
    if not ranked:
        raise UsageError("the data contain no pairs", hint="load the folder of the pairs' release")
    pairs = ranked[0]
    every = f"({_sql(opened, pairs, ranked, keyword)})"
    if drawn is not None:
        try:
            ids = pq.read_table(drawn, columns=["pair_id", "split"])
        except (OSError, pa.ArrowException) as error:
            if is_out_of_memory(error):
                raise
            raise UsageError(
                f"{drawn} is not a file of drawn pairs",
                hint="give pairs.parquet of `kb pairs draw`",
            ) from error
        opened.con.register("drawn_pairs", ids)
        every += " JOIN drawn_pairs USING (pair_id)"
    asked = f"""
        SELECT * FROM {every} WHERE {where or "true"}
        ORDER BY video_id, clip_start_s, pair_id"""
    clips = Clips(query.select(opened.con, asked, views=opened.views).read_all())
    if len(clips) or where or keyword is None:
        return clips
    listed = opened.rows(f"SELECT DISTINCT keyword FROM {pairs.full}")["keyword"].to_pylist()
    known = cast("list[str]", listed)
    if keyword.lower() in map(str.lower, known):  # all of its clips have been removed
        return clips
    raise UsageError(
        f"no clips of {keyword!r}.{did_you_mean(similar(keyword, known))}",
        hint='data.sql("SELECT DISTINCT keyword FROM pairs") lists the keywords',
    )


def _sql(opened: OpenTables, pairs: View, ranked: list[View], keyword: str | None) -> str:
    joins, text, measures = [], "NULL::VARCHAR", ""
    holding = [view for view in ranked if "text" in TableView(view).schema.names]
    if pairs in holding:
        text = "p.text"
    elif holding:
        joins.append(f"LEFT JOIN {holding[0].full} AS t USING (pair_id)")
        text = "t.text"
    videos = opened.ranked("youtube_videos")
    of_video = ", ".join(f"v.{name}" if videos else f"NULL AS {name}" for name in _OF_VIDEO)
    if videos:
        joins.append(f"LEFT JOIN {videos[0].full} AS v ON v.video_id = p.video_id")
    own = known = [*TableView(pairs).columns]
    for name in ("pairs_quality", "pairs_scores", "film_figures"):
        for measured in opened.ranked(name)[:1]:
            joins.append(f"LEFT JOIN {measured.full} AS {name} ON {name}.pair_id = p.pair_id")
            columns = TableView(measured).columns
            keys = ", ".join(key for key in columns if key in known)
            measures += f", {name}.* EXCLUDE ({keys})"
            known = [*known, *columns]
    timing = "p.timing" if "timing" in own else "NULL::VARCHAR"
    removed = [
        f"SELECT key FROM {view.full} WHERE source = '{source}'"
        for source in (*made_of("pairs"), "pairs")
        for view in opened.ranked(f"{source}_tombstones")
    ]
    left = f"AND p.video_id NOT IN ({' UNION ALL '.join(removed)})" if removed else ""
    asked = "true"
    if keyword is not None:
        asked = f"lower(p.keyword) = lower({text_literal(keyword)})"
    return f"""
        SELECT p.pair_id, p.keyword, p.keyword_kind, p.video_id, {of_video},
            p.clip_start_s, p.clip_end_s,
            'https://www.youtube.com/watch?v=' || p.video_id
                || '&t=' || floor(p.clip_start_s)::BIGINT || 's' AS url,
            {text} AS text, p.token_count, p.transcript_kind, {timing} AS timing{measures}
        FROM {pairs.full} AS p {" ".join(joins)}
        WHERE {asked} {left}"""
