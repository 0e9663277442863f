"""Where single clips come from: the user's films (kb.clips.film_lookup), or shards that `kb clips`
has cut. All clips of a film are cut in one pass.
"""

from __future__ import annotations

import io
import tarfile
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Protocol

import msgspec

from kb.clips.clip_files import CutOptions, Row, ShardReport, shard_reports
from kb.clips.film_lookup import MISSING, find_films
from kb.clips.frames import Fit, UndecodableVideo, frames_at
from kb.core.errors import UsageError
from kb.core.installation import np
from kb.core.regular_file import open_regular

# The images of a clip (uint8 [frames, height, width, 3], RGB) and their times (float64 [frames]).
Frames = tuple[np.ndarray, np.ndarray]


class NoClip(Exception):
    """A pair whose clip can't be had; its text says why."""


class ClipSource(Protocol):
    """Has the clips of some pairs, in any order."""

    def lack(self, row: Row) -> tuple[str, str] | None:
        """Why the pair has no clip: a reason of kb.clips.film_lookup, and a sentence. None where
        there is a file.
        """

    def read(self, row: Row) -> Frames:
        """The clip of a pair. Raises NoClip."""


class Films:
    """Decodes each clip when it is asked for."""

    def __init__(
        self, folders: Iterable[Path], lengths_s: Mapping[str, float | None], options: CutOptions
    ) -> None:
        """`lengths_s`: of each video, None where it is not known. Raises UsageError for a folder
        that does not exist.
        """
        folders = list(folders)
        for folder in folders:
            if not folder.is_dir():
                raise UsageError(f"{folder} is not a folder")
        self._found, self._options = find_films(folders, lengths_s), options

    def lack(self, row: Row) -> tuple[str, str] | None:
        video_id = row["video_id"]
        return None if video_id in self._found.films else self._found.reason(video_id)

    def read(self, row: Row) -> Frames:
        options = self._options
        times = frame_times(row["clip_start_s"], row["clip_end_s"], options.frames)
        try:
            film = self._found.films[row["video_id"]]
            for _, images in cut(film, [times], options.size, options.fit):
                return images, times
        except UndecodableVideo as error:
            raise NoClip(str(error)) from None
        except FileNotFoundError:
            raise NoClip("the file is gone") from None
        raise NoClip("the film has no picture for the whole clip")


class Shards:
    """Reads clips from the folder that `kb clips` wrote."""

    def __init__(self, folder: Path, options: CutOptions) -> None:
        """Raises UsageError without shards, or if their frames are of another number or size."""
        self._folder = folder
        self._places: dict[str, tuple[ShardReport, Path, int]] = {}
        for name, report in shard_reports(folder):
            made = report.options
            if (made.frames, made.size, made.fit) != (options.frames, options.size, options.fit):
                raise UsageError(
                    f"{folder / name}.tar has clips of {_shape(made)}, not {_shape(options)}",
                    hint="give frames, size and fit as the shards have them",
                )
            for pair, place in report.clips.items():
                self._places[pair] = report, folder / f"{name}.tar", place
        if not self._places:
            raise UsageError(
                f"{folder} has no clips", hint="`kb clips --videos DIR --out DIR` cuts them"
            )

    def lack(self, row: Row) -> tuple[str, str] | None:
        there = row["pair_id"] in self._places
        return None if there else (MISSING, "no clip in the shards")

    def read(self, row: Row) -> Frames:
        report, path, place = self._places[row["pair_id"]]
        try:
            if report.options.format == "npz":
                path = self._folder / row["video_id"] / f"{row['pair_id']}.npz"
                with open_regular(path) as file, np.load(file) as arrays:
                    return np.moveaxis(arrays["video"], 1, -1), arrays["frame_times_s"]
            return _from_tar(path, place, report.options.frames)
        except (OSError, tarfile.TarError, ValueError, KeyError) as error:
            why = getattr(error, "strerror", None) or error
            raise NoClip(f"{path.name} can't be read: {why}") from None


def _shape(options: CutOptions) -> str:
    height, width = options.size
    return f"{options.frames} frames of {height}x{width} ({options.fit})"


def _from_tar(path: Path, place: int, frames: int) -> Frames:
    """The clip whose files begin at this byte."""
    from PIL import Image

    with open_regular(path) as file:
        file.seek(place)
        with tarfile.open(fileobj=file, mode="r:") as tar:
            parts = [_content(tar) for _ in range(frames + 1)]
    images = [np.asarray(Image.open(io.BytesIO(part))) for part in parts[:-1]]
    times: list[float] = msgspec.json.decode(parts[-1])["frame_times_s"]
    return np.stack(images), np.array(times)


def _content(tar: tarfile.TarFile) -> bytes:
    member = tar.next()
    file = tar.extractfile(member) if member else None
    if file is None:
        raise tarfile.ReadError("it ends too early")
    return file.read()


def frame_times(start_s: float, end_s: float, frames: int) -> np.ndarray:
    """The centres of as many equal parts of a clip (s, float64)."""
    return start_s + (np.arange(frames) + 0.5) / frames * (end_s - start_s)


def cut(
    path: Path, times_s: Sequence[np.ndarray], size: tuple[int, int], fit: Fit
) -> Iterator[tuple[int, np.ndarray]]:
    """Each clip by its number, with its frames: uint8 [frames, height, width, 3], RGB.

    `times_s`: of the frames of each clip (`frame_times`). Clips come in the order of their ends;
    those for which the film has no picture, as it begins later or ends before, are left out. Clips
    that overlap share the decoding, and only they are in memory together. Raises UndecodableVideo,
    behind the clips before the fault.
    """
    clips = np.repeat(np.arange(len(times_s)), [len(one) for one in times_s])
    times = np.concatenate([*times_s, np.zeros(0)])
    order = np.argsort(times, kind="stable")
    cutting: dict[int, list[np.ndarray]] = {}
    without_picture: set[int] = set()
    shown = frames_at(path, times[order].tolist(), size, fit)
    for clip, image in zip(clips[order].tolist(), shown, strict=False):
        if image is None:
            without_picture.add(clip)
        if image is None or clip in without_picture:
            continue
        images = cutting.setdefault(clip, [])
        images.append(image)
        if len(images) == len(times_s[clip]):
            yield clip, np.stack(cutting.pop(clip))
