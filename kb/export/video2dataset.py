"""`kb pairs --format video2dataset`: the list of clips that video2dataset downloads and cuts.

`export/video2dataset/pairs.parquet`, one row a clip, sorted by video and start: `url`, `caption`
(the clip's own text), `clips` ([[start, end]] in seconds); `video_id`, `pair_id` and `keyword` go
along with `save_additional_columns`. A video with several clips has several rows: video2dataset
copies the caption of a row to every clip that it cuts out of it.

    video2dataset --url_list pairs.parquet --input_format parquet --url_col url \\
        --caption_col caption --clip_col clips
"""

from pathlib import Path
from typing import Any

import pyarrow as pa

from kb.core.context import Run
from kb.export.rows import check_rows, sorted_rows
from kb.store.atomic import writing
from kb.store.layout import Layout
from kb.store.tables import parquet

_COLUMNS = ["video_id", "pair_id", "keyword", "text", "clip_start_s", "clip_end_s"]
_ROWS = 16_384  # clips written at a time


def schema() -> pa.Schema:
    """Columns of the file."""
    return pa.schema(
        {
            "url": pa.string(),
            "caption": pa.string(),
            "clips": pa.list_(pa.list_(pa.float64())),
            "video_id": pa.string(),
            "pair_id": pa.string(),
            "keyword": pa.string(),
        }
    )


def write(run: Run) -> Path:
    """Writes the file. Raises FatalError when there is no index, and DiskFull."""
    check_rows(run.root, "pairs/pairs")
    path = Layout(run.root).export("video2dataset", "pairs.parquet")
    with (
        writing(path) as temporary,
        parquet.writing(temporary, schema()) as file,
    ):
        waiting: list[dict[str, Any]] = []
        for row in sorted_rows(run.root, "pairs/pairs", _COLUMNS):
            waiting.append(_clip(row))
            if len(waiting) == _ROWS:
                file.write_table(pa.Table.from_pylist(waiting, schema()))
                waiting = []
        file.write_table(pa.Table.from_pylist(waiting, schema()))
    return path


def _clip(row: dict[str, Any]) -> dict[str, Any]:
    return {
        "url": f"https://www.youtube.com/watch?v={row['video_id']}",
        "caption": row["text"] or "",
        "clips": [[row["clip_start_s"], row["clip_end_s"]]],
        "video_id": row["video_id"],
        "pair_id": row["pair_id"],
        "keyword": row["keyword"],
    }
