"""The files of clips: webdataset shards, or one NumPy archive a clip."""

from __future__ import annotations

import io
import tarfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Literal, Protocol

import msgspec

from kb.clips.frames import Fit
from kb.core.installation import np
from kb.pairs.clip_tokens import token_ids
from kb.store.atomic import writing
from kb.store.damage import read_note

Row = dict[str, Any]
NOT_ALIGNED = "not_aligned"  # a reason why a pair has no clip


class CutOptions(msgspec.Struct, frozen=True):
    """How clips are cut: `size` is height and width in px, `jpeg_quality` 1 to 100."""

    frames: int = 16
    size: tuple[int, int] = (160, 256)
    fit: Fit = "stretch"
    format: Literal["webdataset", "npz"] = "webdataset"
    jpeg_quality: int = 90


class LeftOut(msgspec.Struct, frozen=True):
    """A pair without a clip. `reason`: missing, short, undecodable, film_differs or not_aligned;
    `what` says more.
    """

    pair_id: str
    video_id: str
    reason: str
    what: str


class ShardReport(msgspec.Struct, frozen=True):
    """What became of the pairs of a shard's videos: `clips` has the byte of the tar at which each
    pair's files begin, 0 for npz. `made_of`: a digest of pairs, files and options.
    """

    made_of: str
    options: CutOptions
    clips: dict[str, int]
    left_out: list[LeftOut]


def shard_report(place: Path, name: str) -> ShardReport | None:
    """The report of a shard; None before it is whole. Raises DamagedData."""
    return read_note(
        place / f"{name}.json", ShardReport, fix="remove it, then run `kb clips` again"
    )


def shard_reports(place: Path) -> Iterator[tuple[str, ShardReport]]:
    """The whole shards of a folder, by name. Raises DamagedData."""
    for path in sorted(place.glob("clips-[0-9]*.json")):
        if report := shard_report(place, path.stem):
            yield path.stem, report


class Writer(Protocol):
    """Writes clips one after another."""

    def add(self, row: Row, images: np.ndarray, times_s: np.ndarray) -> int:
        """Write a clip: its pair's row, frames (uint8 [frames, height, width, 3]) and times.
        The byte of the shard at which its files begin, or 0.
        """


@contextmanager
def writer_of(options: CutOptions, place: Path, name: str) -> Iterator[Writer]:
    """A writer of a shard's clips, whose tar takes its place when the block ends well.

    Raises DiskFull.
    """
    if options.format == "npz":
        yield ArchiveWriter(place)
        return
    with (
        writing(place / f"{name}.tar") as temporary,
        tarfile.open(temporary, "w", format=tarfile.USTAR_FORMAT) as tar,
    ):
        yield ShardTarWriter(tar, options.jpeg_quality)


class ShardTarWriter:
    """A webdataset shard: `<pair>.00.jpg` …, `<pair>.json` with row and frame times, and
    `<pair>.tokens.npy` where the pair has a text.
    """

    def __init__(self, tar: tarfile.TarFile, quality: int) -> None:
        self._tar, self._quality = tar, quality

    def add(self, row: Row, images: np.ndarray, times_s: np.ndarray) -> int:
        """Write a clip; the byte at which its files begin."""
        from PIL import Image

        key, place = row["pair_id"], int(self._tar.offset)
        for number, image in enumerate(images):
            jpeg = io.BytesIO()
            Image.fromarray(image).save(jpeg, "JPEG", quality=self._quality)
            self._file(f"{key}.{number:02d}.jpg", jpeg.getvalue())
        about = {**row, "frame_times_s": times_s.tolist()}
        self._file(f"{key}.json", msgspec.json.encode(about, order="deterministic"))
        if row["text"] is not None:
            tokens = io.BytesIO()
            np.save(tokens, token_ids(row["text"]), allow_pickle=False)
            self._file(f"{key}.tokens.npy", tokens.getvalue())
        return place

    def _file(self, name: str, data: bytes) -> None:
        info = tarfile.TarInfo(name)
        info.size = len(data)
        self._tar.addfile(info, io.BytesIO(data))


class ArchiveWriter:
    """`<video>/<pair>.npz`: video (uint8 [frames, 3, height, width]), tokens (int64 [77]) where
    the pair has a text, frame_times_s (float64 [frames]), and the row as JSON.
    """

    def __init__(self, place: Path) -> None:
        self._place = place

    def add(self, row: Row, images: np.ndarray, times_s: np.ndarray) -> int:
        """Write a clip."""
        arrays = {
            "video": np.moveaxis(images, -1, 1),
            "frame_times_s": times_s,
            "row": np.array(msgspec.json.encode(row, order="deterministic").decode()),
        }
        if row["text"] is not None:
            arrays["tokens"] = token_ids(row["text"])
        path = self._place / row["video_id"] / f"{row['pair_id']}.npz"
        with writing(path) as temporary, temporary.open("wb") as file:
            np.savez(file, allow_pickle=False, **arrays)
        return 0
