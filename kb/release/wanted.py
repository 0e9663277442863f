"""What downloaded releases name that is to be brought back."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple, cast

from kb.artifacts.release_folder import ReleaseFolder
from kb.core.errors import SettingError
from kb.store import parquet
from kb.store.reading import reading

COLUMNS = ("video_id", "transcript_kind")


class WantedContent(NamedTuple):
    """Ids of videos, and folders of the rest."""

    videos: list[str]
    had: dict[str, str]  # the kind of transcript that a released video had
    reddit: list[Path]
    pairs: list[Path]
    removed: dict[str, set[str]]  # tombstones of the releases, by source


def choose(folders: Sequence[ReleaseFolder], only: str | None) -> WantedContent:
    """What these folders need, of the source `only` if one is named. Raises SettingError."""
    mine = [one for one in folders if only is None or one.source == only]
    if only and not mine:
        raise SettingError(
            f"--only {only}: none of the folders is of {only}",
            hint=f"they are of {', '.join(sorted({one.source for one in folders}))}",
        )
    removed: dict[str, set[str]] = {"youtube": set(), "reddit": set()}
    for one in folders:
        of = "youtube" if one.source == "pairs" else one.source
        if of in removed:
            removed[of] |= one.removed()
    had: dict[str, str] = {}
    for one in mine:
        for path in (*one.shards("videos"), *one.shards("pairs")):
            with reading([path]):
                rows = parquet.read_table(path, columns=[*COLUMNS])
            keys, kinds = (cast("list[str]", rows[name].to_pylist()) for name in COLUMNS)
            had |= zip(keys, kinds, strict=True)
    return WantedContent(
        list(had),
        had,
        [one.path for one in mine if one.source == "reddit"],
        [one.path for one in mine if one.source == "pairs"],
        removed,
    )
