"""The layouts of pairs for CLIP4MC and video2dataset.

`kb pairs --format clip4mc` writes `export/clip4mc/`, a pair a line:

    dataset.json          every pair
    dataset_test.json     those of one video in twenty, by its id
    dataset_train.json    the others: no video is in both

A pair is `{"vid", "transcript clip", "size", "begin position", "end position"}`. Positions are the
clip's seconds in the video. `size` is a number for each of 16 frames: the target's share of the
frame, which CLIP4MC's tools get from the video itself. Lorecrawl never reads the video, so it is
1.0, with which CLIP4MC weights no pair, until its tools fill it in. Files are ASCII.
Source: Jiang et al., "Reinforcement Learning Friendly Vision-Language Model for Minecraft" (2023).

`kb pairs --format video2dataset` writes the list of clips that video2dataset downloads and cuts:
`export/video2dataset/pairs.parquet`, one row a clip, sorted by video and start: `url`, `caption`
(the clip's own text), `clips` ([[start, end]] in seconds); `video_id`, `pair_id` and `keyword` go
along with `save_additional_columns`. A video with several clips has several rows: video2dataset
copies the caption of a row to every clip that it cuts out of it, and downloads the video for each.
`videos.parquet` beside it has one row a video with all of its clips, so that each is downloaded
once: without captions, but `pair_id` and `keyword` are lists in the order of `clips`.

    video2dataset --url_list pairs.parquet --input_format parquet --url_col url \\
        --caption_col caption --clip_col clips
"""

import hashlib
from itertools import groupby
from pathlib import Path
from typing import Any

import pyarrow as pa

from kb.core.context import Run
from kb.core.errors import FatalError
from kb.export.rows import check_rows, json_list, sorted_rows
from kb.store.atomic import writing
from kb.store.layout import Layout
from kb.store.tables import parquet

_FRAMES = 16
_ONE_IN = 20  # videos, for the test split
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


def clip4mc(run: Run) -> Path:
    """Writes the files, row by row. Raises FatalError when pairs have no text, and DiskFull."""
    check_rows(run.root, "pairs/pairs")
    folder = Layout(run.root).export("clip4mc")
    path = folder / "dataset.json"
    with (
        json_list(path) as add,
        json_list(folder / "dataset_test.json") as add_test,
        json_list(folder / "dataset_train.json") as add_train,
    ):
        for row in sorted_rows(
            run.root, "pairs/pairs", ["video_id", "text", "clip_start_s", "clip_end_s"]
        ):
            if row["text"] is None:
                raise FatalError(
                    "a pair has no text",
                    hint="run `kb pairs`, or `kb pairs --from-index FILE` with all transcripts",
                )
            pair = {
                "vid": row["video_id"],
                "transcript clip": row["text"],
                "size": [1.0] * _FRAMES,
                "begin position": row["clip_start_s"],
                "end position": row["clip_end_s"],
            }
            add(pair)
            (add_test if in_test(row["video_id"]) else add_train)(pair)
    return path


def in_test(video_id: str) -> bool:
    """Whether a video's pairs are in the test split: the same in every run and release."""
    digest = hashlib.sha256(video_id.encode()).digest()
    return int.from_bytes(digest[:8], "big") % _ONE_IN == 0


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
            clips = [_clip(row) for row in own]
            waiting += clips
            waiting_videos.append(_video(clips))
            if len(waiting) >= _ROWS:
                file.write_table(pa.Table.from_pylist(waiting, _CLIPS))
                by_video.write_table(pa.Table.from_pylist(waiting_videos, _VIDEOS))
                waiting, waiting_videos = [], []
        file.write_table(pa.Table.from_pylist(waiting, _CLIPS))
        by_video.write_table(pa.Table.from_pylist(waiting_videos, _VIDEOS))
    return path


def _video(clips: list[dict[str, Any]]) -> dict[str, Any]:
    """All clips of a video as one row."""
    return {
        "url": clips[0]["url"],
        "clips": [one["clips"][0] for one in clips],
        "video_id": clips[0]["video_id"],
        "pair_id": [one["pair_id"] for one in clips],
        "keyword": [one["keyword"] for one in clips],
    }


def _clip(row: dict[str, Any]) -> dict[str, Any]:
    return {
        "url": f"https://www.youtube.com/watch?v={row['video_id']}",
        "caption": row["text"] or "",
        "clips": [[row["clip_start_s"], row["clip_end_s"]]],
        "video_id": row["video_id"],
        "pair_id": row["pair_id"],
        "keyword": row["keyword"],
    }
