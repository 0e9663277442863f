r"""`kb pairs --format video2dataset`: the list of clips that video2dataset downloads and cuts.

`export/video2dataset/pairs.parquet`, one row a video, sorted by its id: `url`, `caption` (the texts
of the clips, one a line), `clips` ([[start, end], …] in seconds); `captions`, `keywords` and
`pair_ids` have an entry a clip and go along with `save_additional_columns`.

    video2dataset --url_list pairs.parquet --input_format parquet \
        --url_col url --caption_col caption --clip_col clips
"""

from __future__ import annotations

from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq

from kb.core.context import Run
from kb.export.pair_rows import by_video
from kb.store.atomic import writing
from kb.store.layout import Layout

_COLUMNS = ["pair_id", "keyword", "text", "clip_start_s", "clip_end_s"]
_ROWS = 4096  # videos written at a time


def schema() -> pa.Schema:
    """Columns of the file."""
    texts = pa.list_(pa.string())
    return pa.schema(
        {
            "url": pa.string(),
            "caption": pa.string(),
            "clips": pa.list_(pa.list_(pa.float64())),
            "video_id": pa.string(),
            "pair_ids": texts,
            "keywords": texts,
            "captions": texts,
        }
    )


def write(run: Run) -> Path:
    """Writes the file. Raises FatalError when there is no index, and DiskFull."""
    path = Layout(run.root).export("video2dataset", "pairs.parquet")
    with (
        writing(path) as temporary,
        pq.ParquetWriter(temporary, schema(), compression="zstd") as file,
    ):
        waiting: list[dict[str, object]] = []
        for video, rows in by_video(run, _COLUMNS):
            texts = [row["text"] for row in rows]
            waiting.append(
                {
                    "url": f"https://www.youtube.com/watch?v={video}",
                    "caption": "\n".join(text for text in texts if text),
                    "clips": [[row["clip_start_s"], row["clip_end_s"]] for row in rows],
                    "video_id": video,
                    "pair_ids": [row["pair_id"] for row in rows],
                    "keywords": [row["keyword"] for row in rows],
                    "captions": texts,
                }
            )
            if len(waiting) == _ROWS:
                file.write_table(pa.Table.from_pylist(waiting, schema()))
                waiting = []
        file.write_table(pa.Table.from_pylist(waiting, schema()))
    return path
