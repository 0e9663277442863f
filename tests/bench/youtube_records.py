"""Synthetic raw video records, and the job written as plain Python over dicts. Run as a script, so
that memory is its own.

    python youtube_records.py make ROOT COUNT      raw/youtube/videos of COUNT records,
                                                   50 an envelope
    python youtube_records.py ours ROOT WORKERS    parse, filter and export by Lorecrawl
    python youtube_records.py plain ROOT           the same by json, dicts and lists

The last two print one line of JSON: seconds, peak memory (MB), rows kept and rejected by stage.
"""

from __future__ import annotations

import json
import random
import resource
import sys
import time
from collections import Counter
from pathlib import Path
from typing import Any

KEYWORDS = ("Minecraft", "Minecraft Guide", "Minecraft Walkthrough", "Minecraft Beginner")


def make(root: Path, count: int) -> None:
    """Raw segments shaped like the recorded answers; the same ones each time."""
    import orjson
    import zstandard

    chance = random.Random(7)
    words = [
        "".join(chance.choices("abcdefghijklmnopqrstuvwxyz", k=chance.randint(2, 9)))
        for _ in range(3000)
    ]
    texts = [" ".join(chance.choices(words, k=60)) for _ in range(3000)]
    folder = root / "raw" / "youtube" / "videos"
    folder.mkdir(parents=True)
    compress = zstandard.ZstdCompressor(3).compress
    per_segment = 2_000  # envelopes, about 60 MB
    for start in range(0, count // 50, per_segment):
        with (folder / f"{start // per_segment + 1:06d}-5eed0000.ndjson.zst").open("wb") as file:
            for number in range(start, min(start + per_segment, count // 50)):
                items = [_item(number * 50 + index, chance, texts) for index in range(50)]
                asked = ",".join(item["id"] for item in items)
                file.write(
                    compress(
                        orjson.dumps(
                            {
                                "fetched_at": "2026-11-20T12:00:00Z",
                                "request": {"endpoint": "videos.list", "params": {"id": asked}},
                                "status": 200,
                                "response": {
                                    "kind": "youtube#videoListResponse",
                                    "etag": "e",
                                    "items": items,
                                    "pageInfo": {"totalResults": 50, "resultsPerPage": 50},
                                },
                            }
                        )
                        + b"\n"
                    )
                )


def _item(number: int, chance: random.Random, texts: list[str]) -> dict[str, Any]:
    key = f"{(number * 2654435761) % (1 << 40):010x}x"
    title = chance.choice(texts)[:50] + (" Minecraft guide" if chance.random() < 0.7 else "")
    statistics = {
        "viewCount": str(int(10 ** (chance.random() * 6))),
        "likeCount": str(chance.randrange(10_000)),
        "favoriteCount": "0",
        "commentCount": "3",
    }
    odd = chance.random()
    if odd < 0.01:
        del statistics["likeCount"]
    elif odd < 0.012:
        statistics["viewCount"] = "-5"
    elif odd < 0.014:
        del statistics["viewCount"]
    tall = chance.random() < 0.1
    return {
        "kind": "youtube#video",
        "etag": "x" * 27,
        "id": key,
        "snippet": {
            "publishedAt": f"20{chance.randrange(10, 26)}-03-21T20:37:49Z",
            "channelId": f"UC{number % 5000:022d}",
            "title": title,
            "description": chance.choice(texts),
            "channelTitle": "a channel",
            "thumbnails": {
                size: {
                    "url": f"https://i.ytimg.com/vi/{key}/{size}.jpg",
                    "width": 120,
                    "height": 90,
                }
                for size in ("default", "medium", "high", "standard", "maxres")
            },
            "tags": chance.choice(texts).split()[:8],
            "categoryId": chance.choice(("20", "20", "20", "22")),
            "liveBroadcastContent": "none",
            "localized": {"title": title, "description": chance.choice(texts)},
            "defaultAudioLanguage": "en",
        },
        "contentDetails": {
            "duration": f"PT{chance.randrange(60)}M{chance.randrange(60)}S"
            if chance.random() > 0.01
            else "P0D",
            "dimension": "2d",
            "definition": "hd",
            "caption": "false",
            "licensedContent": True,
            "contentRating": {"ytRating": "ytAgeRestricted"} if chance.random() < 0.01 else {},
            "projection": "rectangular",
        },
        "status": {
            "uploadStatus": "processed",
            "privacyStatus": "public",
            "license": "youtube",
            "embeddable": True,
            "publicStatsViewable": True,
            "madeForKids": False,
        },
        "statistics": statistics,
        "player": {
            "embedHtml": "<iframe></iframe>",
            "embedWidth": "405" if tall else "854",
            "embedHeight": "720" if tall else "480",
        },
    }


def ours(root: Path, workers: int) -> dict[str, Any]:
    """`kb youtube filter` and `export`; neither label, transcripts nor model,
    so that the columns are what is measured.
    """
    from kb.core.context import Run
    from kb.core.profile import load_profile
    from kb.core.settings import Settings
    from kb.export import parquet
    from kb.filters.clean import run_clean

    profile = load_profile("minecraft")
    youtube = profile.youtube.model_copy(
        update={"game_ids": (), "transcripts": "optional", "topic_keywords": KEYWORDS}
    )
    toxicity = profile.toxicity.model_copy(update={"toxicity": "off"})
    profile = profile.model_copy(update={"youtube": youtube, "toxicity": toxicity})
    run = Run(settings=Settings(), profile=profile, root=root, workers=workers)
    summary = run_clean(run, "youtube")
    parquet.export(run, "youtube")
    return {"kept": summary["kept"], "rejected": summary["stages"]}


def plain(root: Path, _: int) -> dict[str, Any]:
    """json.loads, dicts, a loop with ifs, one sorted list, the same released columns."""
    import re

    import pyarrow as pa
    import pyarrow.parquet as pq
    import zstandard

    word = re.compile("|".join(rf"\b{re.escape(key)}\b" for key in KEYWORDS), re.IGNORECASE)
    shape = re.compile(r"P(?:(\d+)D)?(?:T(?:(\d+)H)?(?:(\d+)M)?(?:(\d+)S)?)?")
    kept: dict[str, dict[str, Any]] = {}
    dropped: list[dict[str, Any]] = []
    for path in sorted((root / "raw" / "youtube" / "videos").glob("*.ndjson.zst")):
        with path.open("rb") as file:
            stream = zstandard.ZstdDecompressor().stream_reader(file, read_across_frames=True)
            rest = b""
            while chunk := stream.read(1 << 20):
                *lines, rest = (rest + chunk).split(b"\n")
                for line in lines:
                    envelope = json.loads(line)
                    for item in envelope["response"]["items"]:
                        answer = _judge(item, envelope["fetched_at"], word, shape)
                        if "stage" in answer:
                            dropped.append(answer)
                        else:
                            kept[answer["video_id"]] = answer
    out = root / "plain"
    out.mkdir(exist_ok=True)
    rows = sorted(kept.values(), key=lambda row: row["video_id"])
    pq.write_table(
        pa.Table.from_pylist(rows),
        out / "videos.parquet",
        compression="zstd",
        row_group_size=131_072,
    )
    dropped.sort(key=lambda row: row["key"])
    pq.write_table(
        pa.Table.from_pylist(dropped),
        out / "rejected.parquet",
        compression="zstd",
        row_group_size=131_072,
    )
    return {"kept": len(rows), "rejected": dict(Counter(row["stage"] for row in dropped))}


def _judge(item: dict[str, Any], fetched_at: str, word: Any, shape: Any) -> dict[str, Any]:
    key, snippet = item["id"], item["snippet"]

    def drop(stage: str, reason: str, value: object, threshold: object) -> dict[str, Any]:
        return {
            "key": key,
            "stage": stage,
            "reason": reason,
            "value": None if value is None else str(value),
            "threshold": str(threshold),
        }

    texts = (snippet["title"], *snippet.get("tags", ()), snippet["description"])
    if int(snippet["categoryId"]) != 20:
        return drop("topic", "category", snippet["categoryId"], 20)
    if not any(word.search(text) for text in texts):
        return drop("topic", "keywords", None, "keywords")
    views = item["statistics"].get("viewCount")
    if views is None:
        return drop("views", "absent", None, 100)
    if not views.isdigit():
        return drop("views", "malformed", views, 100)
    if int(views) < 100:
        return drop("views", "below", views, 100)
    width, height = int(item["player"]["embedWidth"]), int(item["player"]["embedHeight"])
    if width / height < 1:
        return drop("aspect_ratio", "below", width / height, 1)
    match = shape.fullmatch(item["contentDetails"]["duration"])
    duration = sum(
        int(part or 0) * size
        for part, size in zip(match.groups(), (86400, 3600, 60, 1), strict=True)
    )
    if duration < 60:
        return drop("duration", "below", duration, 60)
    if item["contentDetails"].get("contentRating", {}).get("ytRating") == "ytAgeRestricted":
        return drop("age_restricted", "age_restricted", None, "")
    likes = item["statistics"].get("likeCount")
    return {
        "video_id": key,
        "title": snippet["title"],
        "link": f"https://www.youtube.com/watch?v={key}",
        "channel_id": snippet["channelId"],
        "published_at": snippet["publishedAt"],
        "category_id": int(snippet["categoryId"]),
        "view_count": int(views),
        "like_count": None if likes is None else int(likes),
        "duration_s": duration,
        "width": width,
        "height": height,
        "fps": None,
        "license": item["status"]["license"],
        "topic_evidence": "keywords",
        "transcript_kind": "unknown",
        "word_count": None,
        "fetched_at": fetched_at,
        "toxicity_title": None,
        "toxicity_description": None,
    }


def main(what: str, root: Path, count: int = 0) -> None:
    if what == "make":
        make(root, count)
        return
    start = time.perf_counter()
    result = {"ours": ours, "plain": plain}[what](root, count)
    result["seconds"] = time.perf_counter() - start
    # Peak of this process and of its largest worker.
    own, child = (
        resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)
    )
    result["cpu_s"] = own.ru_utime + own.ru_stime + child.ru_utime + child.ru_stime
    print(json.dumps(result | {"peak_mb": own.ru_maxrss >> 10, "worker_mb": child.ru_maxrss >> 10}))


if __name__ == "__main__":
    main(sys.argv[1], Path(sys.argv[2]), *map(int, sys.argv[3:]))
