"""A data root in which one video is in every folder, for tests of purges, damage and indexes."""

from pathlib import Path

from kb.export import layouts, minedojo
from kb.filters.filter_run import run_clean
from kb.pairs.build import build
from tests.filters.made import MONDAY, cues, listing, put, run_at, transcript, video

GONE, OTHER = "AAAAAAAAAA1", "AAAAAAAAAA2"


def make(root: Path) -> None:
    """The texts of the video GONE are found nowhere else."""
    keys = [GONE, OTHER, *(f"BBBBBBBBB{number:02d}" for number in range(8))]
    put(root, "videos", (MONDAY, {"id": ",".join(keys)}, listing(*map(_video, keys))))
    put(root, "transcripts", *(transcript(key, cues=_cues(key)) for key in keys))
    run = run_at(root)
    run_clean(run, "youtube")
    build(run)
    layouts.write_parquet(run, "youtube")
    layouts.write_parquet(run, "pairs")
    minedojo.youtube(run)


def _video(key: str) -> dict[str, object]:
    return video(key, snippet__title="Zanzibar marmalade" if key == GONE else f"Minecraft {key}")


def _cues(key: str) -> dict[str, object]:
    words = "quinquereme of nineveh" if key == GONE else "we dig down a little"
    said = f"{words} and a creeper comes along number"
    return cues(*([at * 3, 3, f"{said} {at}"] for at in range(12)))
