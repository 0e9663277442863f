"""A small data root of ten videos: filtered, paired and exported."""

from __future__ import annotations

from pathlib import Path

from kb.core.pipeline import load, locate
from kb.export import minedojo, parquet
from kb.filters.clean import run_clean
from kb.pairs.build import build
from tests.filters.made import MONDAY, listing, put, run_at, transcript, video

GONE, OTHER = "AAAAAAAAAA1", "AAAAAAAAAA2"


def make(root: Path) -> None:
    """Raw data, clean tables, pairs and exports."""
    keys = [GONE, OTHER, *(f"BBBBBBBBB{number:02d}" for number in range(8))]
    videos = [video(key, snippet__title=f"Minecraft {key}") for key in keys]
    put(root, "videos", (MONDAY, {"id": ",".join(keys)}, listing(*videos)))
    cues = [[at * 3, 3, f"we dig down and a creeper comes along number {at}"] for at in range(12)]
    put(root, "transcripts", *(transcript(key, cues=cues) for key in keys))
    run = run_at(root)
    run_clean(run, "youtube")
    build(run)
    parquet.export(run, "youtube")
    parquet.export(run, "pairs")
    minedojo.youtube(run)


def purge(root: Path, *keys: str) -> None:
    """`kb purge youtube --ids`."""
    ids = root.parent / f"{root.name}.txt"
    ids.write_text("".join(f"{key}\n" for key in keys))
    load(str(locate("purge", None))).purge(run_at(root), "youtube", ids)
