"""Raw answers of YouTube by hand, and a run of the filter on them."""

import hashlib
import shutil
from pathlib import Path
from typing import Any

import pyarrow.parquet as pq

from kb.core.config.profile import load_profile
from kb.core.config.settings import Settings
from kb.core.context import Run
from kb.store.rawlog import rawlog
from kb.youtube.parse.answers import FORMAT
from kb.youtube.ytdlp import subtitles

GAME = "UCQvWX73GQygcwXOTSf_VDVg"
MONDAY, TUESDAY = "2026-11-16T12:00:00Z", "2026-11-17T12:00:00Z"


def video(key: str, **change: Any) -> dict[str, Any]:
    item: dict[str, Any] = {
        "id": key,
        "snippet": {
            "title": f"Minecraft {key}",
            "publishedAt": "2020-01-01T00:00:00Z",
            "channelId": "UC1",
            "categoryId": "20",
            "description": "d",
        },
        "contentDetails": {"duration": "PT5M"},
        "statistics": {"viewCount": "1000", "likeCount": "5"},
        "status": {"license": "youtube"},
        "player": {"embedWidth": "854", "embedHeight": "480"},
    }
    for path, value in change.items():
        change_at(item, path.split("__"), value)
    return item


def change_at(item: dict[str, Any], path: list[str], value: Any) -> None:
    """Set what stands at a path of names; KeyError takes it away."""
    *parents, last = path
    for step in parents:
        item = item[step]
    if value is KeyError:
        del item[last]
    else:
        item[last] = value


def put(root: Path, kind: str, *envelopes: tuple[str, dict[str, Any], Any]) -> None:
    """One closed segment of (fetched_at, params, response)."""
    segment = rawlog.Segment(rawlog.folder(root, "youtube", kind))
    for fetched_at, params, response in envelopes:
        envelope = rawlog.Envelope(fetched_at, rawlog.Request(kind, params), 200, response)
        segment.append(rawlog.encode(envelope))
    segment.close()


def listing(*items: dict[str, Any]) -> dict[str, Any]:
    return {"items": list(items)}


def cues(*rows: list[Any]) -> dict[str, Any]:
    """Cues as a raw answer has them, of [start_s, duration_s, text, word_start_s] each."""
    return subtitles.as_columns([subtitles.Cue(*row) for row in rows])


def transcript(key: str, outcome: str = "ok", **change: Any) -> tuple[str, dict[str, Any], Any]:
    response = {
        "format": FORMAT,
        "video_id": key,
        "outcome": outcome,
        "kind": "asr",
        "language": "en",
        "cues": cues([0, 2, "one two"], [1, 2, "three"]),
        "player": {
            "width": 1920,
            "height": 1080,
            "fps": 60,
            "game_label_id": GAME,
            "game_label": "Minecraft",
        },
    } | change
    if outcome != "ok":
        response |= {"kind": None, "language": None, "cues": None}
    return MONDAY, {}, response


def run_at(root: Path, workers: int = 1, pipeline: Path | None = None, **youtube: Any) -> Run:
    profile = load_profile("minecraft")
    if pipeline is not None:  # beside a profile that names it
        place = shutil.copytree(profile.path.parent, pipeline.parent, dirs_exist_ok=True)
        profile = load_profile(place / "profile.toml", named=True)
        youtube["pipeline"] = pipeline.name
    changed = profile.youtube.model_copy(update=youtube)
    toxicity = profile.toxicity.model_copy(update={"toxicity": "off"})
    return Run(
        settings=Settings(),
        profile=profile.model_copy(update={"youtube": changed, "toxicity": toxicity}),
        root=root,
        workers=workers,
    )


def rows(root: Path, name: str) -> dict[str, dict[str, Any]]:
    found = pq.read_table(root / "clean" / "youtube" / name).to_pylist()
    return {row.get("key", row.get("video_id")): row for row in found}


def digests(folder: Path) -> dict[str, str]:
    return {
        str(path.relative_to(folder)): hashlib.sha256(path.read_bytes()).hexdigest()
        for path in sorted(folder.rglob("*"))
        if path.is_file()
    }
