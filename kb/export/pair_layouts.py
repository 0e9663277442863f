"""The list of clips that video2dataset downloads and cuts.

`kb pairs --format video2dataset` writes `export/video2dataset/pairs.parquet`, one row a clip,
sorted by video and start: `url`, `caption` (the clip's own text), `clips` ([[start, end]] in
seconds); `video_id`, `pair_id` and `keyword` go along with `save_additional_columns`. A video with
several clips has several rows: video2dataset copies the caption of a row to every clip that it cuts
out of it, and downloads the video for each. `videos.parquet` beside it has one row a video with all
of its clips, so that each is downloaded once: without captions, but `pair_id` and `keyword` are
lists in the order of `clips`.

    video2dataset --url_list pairs.parquet --input_format parquet --url_col url \\
        --caption_col caption --clip_col clips
"""

from itertools import groupby
from pathlib import Path
from typing import Any

import pyarrow as pa

from kb.core.context import Run
from kb.export.rows import check_rows, sorted_rows
from kb.store.atomic import writing
from kb.store.layout import Layout
from kb.store.tables import parquet

_TEXT = pa.string()
_CLIPS = pa.schema(
    {
        "url": _TEXT,
        "caption": _TEXT,
        "clips": pa.list_(pa.list_(pa.float64())),
        "video_id": _TEXT,
        "pair_id": _TEXT,
        "keyword": _TEXT,
    }
)
_VIDEOS = pa.schema(
    {
        "url": _TEXT,
        "clips": pa.list_(pa.list_(pa.float64())),
        "video_id": _TEXT,
        "pair_id": pa.list_(_TEXT),
        "keyword": pa.list_(_TEXT),
    }
)
_ROWS = 16_384  # clips written at a time


def video2dataset(run: Run) -> Path:
    """Writes both files. Raises FatalError when there is no index, and DiskFull."""
    check_rows(run.root, "pairs/pairs")
    path = Layout(run.root).export("video2dataset", "pairs.parquet")
    columns = ["video_id", "pair_id", "keyword", "text", "clip_start_s", "clip_end_s"]
    rows = sorted_rows(run.root, "pairs/pairs", columns)
    with (
        writing(path) as pairs,
        writing(path.with_name("videos.parquet")) as videos,
        parquet.writing(pairs, _CLIPS) as file,
        parquet.writing(videos, _VIDEOS) as by_video,
    ):
        waiting: list[dict[str, Any]] = []
        waiting_videos: list[dict[str, Any]] = []
        for _, own in groupby(rows, key=lambda row: row["video_id"]):
            clips = [
                {
                    "url": f"https://www.youtube.com/watch?v={row['video_id']}",
                    "caption": row["text"] or "",
                    "clips": [[row["clip_start_s"], row["clip_end_s"]]],
                    "video_id": row["video_id"],
                    "pair_id": row["pair_id"],
                    "keyword": row["keyword"],
                }
                for row in own
            ]
            waiting += clips
            waiting_videos.append(
                {
                    "url": clips[0]["url"],
                    "clips": [clip["clips"][0] for clip in clips],
                    "video_id": clips[0]["video_id"],
                    "pair_id": [clip["pair_id"] for clip in clips],
                    "keyword": [clip["keyword"] for clip in clips],
                }
            )
            if len(waiting) >= _ROWS:
                file.write_table(pa.Table.from_pylist(waiting, _CLIPS))
                by_video.write_table(pa.Table.from_pylist(waiting_videos, _VIDEOS))
                waiting, waiting_videos = [], []
        file.write_table(pa.Table.from_pylist(waiting, _CLIPS))
        by_video.write_table(pa.Table.from_pylist(waiting_videos, _VIDEOS))
    return path
