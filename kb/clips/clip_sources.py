"""Where single clips come from (the user's films, or shards that `kb clips` has cut), and a PyTorch
dataset of them.

The film of a video is `ID.ext`, `TITLE [ID].ext` as yt-dlp names it, `TITLE-ID.ext` as youtube-dl
did, or a file in `ID/`; where that is missing the largest of its streams (`ID.f137.ext`). All clips
of a film are cut in one pass.
"""

from __future__ import annotations

import hashlib
import io
import os
import tarfile
import warnings
from collections import Counter, defaultdict
from collections.abc import Collection, Iterable, Iterator, Sequence
from functools import cache
from pathlib import Path
from typing import Any, Protocol, cast

import msgspec
import pyarrow as pa

from kb.clips.clip_files import CutOptions, Row, ShardReport, shard_reports
from kb.clips.frames import Fit, UndecodableVideo, frames_at
from kb.core.cached_property import cached_property
from kb.core.errors import UsageError
from kb.core.installation import np, torch
from kb.core.video_names import possible_ids, without_stream
from kb.pairs.clip_tokens import token_ids
from kb.pairs.seeded_random import bits, video_keys

_ENDINGS = frozenset(
    (".mp4", ".m4v", ".mkv", ".webm", ".mov", ".avi", ".flv", ".ts", ".3gp", ".mpg", ".mpeg")
)

# The images of a clip (uint8 [frames, height, width, 3], RGB) and their times (float64 [frames]).
Frames = tuple[np.ndarray, np.ndarray]


class NoClip(Exception):
    """A pair whose clip can't be had; its text says why."""


class ClipSource(Protocol):
    """Has the clips of some pairs, in any order."""

    def has(self, row: Row) -> bool:
        """Whether there is a file for the pair."""

    def read(self, row: Row) -> Frames:
        """The clip of a pair. Raises NoClip."""


class Films:
    """Decodes each clip when it is asked for."""

    def __init__(
        self, folders: Iterable[Path], video_ids: Collection[str], options: CutOptions
    ) -> None:
        """Raises UsageError for a folder that does not exist."""
        folders = list(folders)
        for folder in folders:
            if not folder.is_dir():
                raise UsageError(f"{folder} is not a folder")
        self._files, self._options = video_files(folders, video_ids), options

    def has(self, row: Row) -> bool:
        return row["video_id"] in self._files

    def read(self, row: Row) -> Frames:
        options = self._options
        times = frame_times(row["clip_start_s"], row["clip_end_s"], options.frames)
        try:
            for _, images in cut(self._files[row["video_id"]], [times], options.size, options.fit):
                return images, times
        except UndecodableVideo as error:
            raise NoClip(str(error)) from None
        except FileNotFoundError:
            raise NoClip("the file is gone") from None
        raise NoClip("the film ends before the clip")


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

    def has(self, row: Row) -> bool:
        return row["pair_id"] in self._places

    def read(self, row: Row) -> Frames:
        report, path, place = self._places[row["pair_id"]]
        try:
            if report.options.format == "npz":
                archive = self._folder / row["video_id"] / f"{row['pair_id']}.npz"
                with np.load(archive) as arrays:
                    return np.moveaxis(arrays["video"], 1, -1), arrays["frame_times_s"]
            return _from_tar(path, place, report.options.frames)
        except (OSError, tarfile.TarError, ValueError, KeyError) as error:
            raise NoClip(f"{path.name} can't be read: {error}") from None


def _shape(options: CutOptions) -> str:
    height, width = options.size
    return f"{options.frames} frames of {height}x{width} ({options.fit})"


def _from_tar(path: Path, place: int, frames: int) -> Frames:
    """The clip whose files begin at this byte."""
    from PIL import Image

    with path.open("rb") as file:
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
    those that the film is too short for are left out. Clips that overlap share the decoding, and
    only they are in memory together. Raises UndecodableVideo, behind the clips before the fault.
    """
    clips = np.repeat(np.arange(len(times_s)), [len(one) for one in times_s])
    times = np.concatenate([*times_s, np.zeros(0)])
    order = np.argsort(times, kind="stable")
    cutting: dict[int, list[np.ndarray]] = {}
    shown = frames_at(path, times[order].tolist(), size, fit)
    for clip, image in zip(clips[order].tolist(), shown, strict=False):
        images = cutting.setdefault(clip, [])
        images.append(image)
        if len(images) == len(times_s[clip]):
            yield clip, np.stack(cutting.pop(clip))


def video_files(folders: Iterable[Path], ids: Collection[str]) -> dict[str, Path]:
    """By video id: its file in these folders or below them. Of several the first one by folder
    and name counts. Raises OSError for a folder that can't be read.
    """
    wanted, paths = frozenset(ids), dict[str, Path]()
    streams = defaultdict[str, list[Path]](list)
    for folder in folders:
        for where, below, files in os.walk(folder, onerror=_refuse):
            below.sort()
            for path in (Path(where, name) for name in sorted(files)):
                if path.suffix.lower() not in _ENDINGS:
                    continue
                stem = without_stream(path.stem)
                named = (*possible_ids(stem), path.parent.name)
                if key := next((one for one in named if one in wanted), ""):
                    if stem == path.stem:
                        paths.setdefault(key, path)
                    else:
                        streams[key].append(path)
    largest = {key: max(some, key=lambda one: one.stat().st_size) for key, some in streams.items()}
    return largest | paths


def _refuse(error: OSError) -> None:
    raise error


class ClipDataset:
    """Clips in an order that depends on seed and epoch, split over ranks and DataLoader workers.

    A clip is a dictionary: `video` (uint8 [frames, 3, height, width], RGB), `tokens` (int64 [77],
    CLIP's ids, padded with 0), `text`, `keyword`, `pair_id`, `video_id`, `frame_times_s` (float64
    [frames]). Each epoch has every clip once over all ranks and workers; ranks differ by one clip
    at most. A clip that can't be read is left out with a warning that says why.

    `left_out` counts the pairs that have no file ("missing") or no text ("no_text").
    """

    def __init__(
        self, rows: pa.Table, source: ClipSource, *, seed: int, rank: int, world_size: int
    ) -> None:
        """`rows`: pair_id, video_id, keyword, text, clip_start_s and clip_end_s of pairs.

        Raises UsageError for a wrong rank, or if no pair has both a text and a file.
        """
        if not 0 <= rank < world_size:
            raise UsageError(f"rank is {rank}", hint=f"a number from 0 to {world_size - 1}")
        reasons = [
            "no_text" if row["text"] is None else "" if source.has(row) else "missing"
            for batch in rows.to_batches()
            for row in batch.to_pylist()
        ]
        self.left_out = Counter(one for one in reasons if one)
        self._rows = rows.filter(pa.array([not one for one in reasons]))
        if not self._rows.num_rows:
            if self.left_out["no_text"]:
                raise UsageError("the pairs have no text", hint="`kb restore` brings it back")
            raise UsageError(
                "no pair has a video file", hint="files are found by id, such as ID.mp4"
            )
        self._source, self.seed, self.rank, self.world_size = source, seed, rank, world_size
        self.epoch = 0
        self._start = self._place = 0  # in this rank's order: where the next pass begins; now
        self._in_workers = torch.zeros(1, dtype=torch.uint8).share_memory_()

    def __len__(self) -> int:
        """Clips of a whole pass of this rank, those included that can't be read."""
        return len(range(self.rank, self._rows.num_rows, self.world_size))

    def __iter__(self) -> Iterator[dict[str, Any]]:
        """The clips of an epoch, or those that a loaded state leaves. The next pass is whole."""
        # At once and not with the first clip, as a loader takes the state of a pass that begins.
        start, self._start = self._start, 0
        self._place = start
        return self._clips(start)

    def _clips(self, start: int) -> Iterator[dict[str, Any]]:
        worker = torch.utils.data.get_worker_info()
        number, workers = (worker.id, worker.num_workers) if worker else (0, 1)
        if worker:
            self._in_workers[0] = 1
        mine = self._order()[self.rank :: self.world_size]
        for place in range(start + (number - start) % workers, len(mine), workers):
            row = self._rows.slice(mine[place], 1).to_pylist()[0]
            self._place = place + 1
            try:
                images, times = self._source.read(row)
            except NoClip as reason:
                warnings.warn(
                    f"pair {row['pair_id']} of video {row['video_id']} has no clip: {reason}",
                    stacklevel=2,
                )
                continue
            yield {
                "video": torch.from_numpy(np.ascontiguousarray(np.moveaxis(images, -1, 1))),
                "tokens": torch.from_numpy(token_ids(row["text"])),
                **{name: row[name] for name in ("text", "keyword", "pair_id", "video_id")},
                "frame_times_s": torch.from_numpy(times),
            }
        self._place = len(mine)

    def set_epoch(self, epoch: int) -> None:
        """Give each epoch another order; call it before every pass, as of DistributedSampler."""
        if epoch != self.epoch:
            self.epoch, self._start, self._place = epoch, 0, 0

    def state_dict(self) -> dict[str, Any]:
        """Where the current pass is, for `load_state_dict`.

        Raises UsageError outside of the worker processes that read the clips, which are ahead of
        what the training has seen; torchdata's StatefulDataLoader keeps the states of workers.
        """
        if self._in_workers[0] and torch.utils.data.get_worker_info() is None:
            raise UsageError(
                "state_dict() can't know how far worker processes are",
                hint="use torchdata.stateful_dataloader.StatefulDataLoader and its state_dict()",
            )
        return {"epoch": self.epoch, "place": self._place, "clips": self._digest}

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Let the next pass begin where the state was taken.

        Raises UsageError for a state of other clips, or of another seed, rank or world size.
        """
        if state["clips"] != self._digest:
            raise UsageError(
                "this state is of other clips, or of another seed, rank or world size",
                hint="load it into a dataset that was made with the same arguments and files",
            )
        self.epoch, self._start = state["epoch"], state["place"]
        self._place = self._start

    def _order(self) -> list[int]:
        """Rows in the order of the epoch."""
        count = self._rows.num_rows
        keys = np.repeat(video_keys(self.seed, [f"epoch {self.epoch}"]), count)
        drawn = bits(keys, np.arange(count), "rank")
        return np.argsort(drawn, kind="stable").tolist()

    @cached_property
    def _digest(self) -> str:
        """What a state belongs to."""
        digest = hashlib.sha256(f"{self.seed} {self.rank} {self.world_size}".encode())
        pairs = cast("list[str]", self._rows["pair_id"].to_pylist())
        digest.update("".join(pairs).encode())
        return digest.hexdigest()


def torch_dataset(
    rows: pa.Table, source: ClipSource, *, seed: int, rank: int, world_size: int
) -> ClipDataset:
    """A ClipDataset that is a torch.utils.data.IterableDataset, as a DataLoader wants it.

    Raises UsageError as ClipDataset does.
    """
    return _torch_class()(rows, source, seed=seed, rank=rank, world_size=world_size)


@cache
def _torch_class() -> Any:
    """The class is made when it is asked for, as torch belongs to an extra."""

    class TorchClipDataset(ClipDataset, torch.utils.data.IterableDataset):  # type: ignore[misc]
        def __reduce__(self) -> tuple[Any, ...]:
            return _unpickled, (self.__dict__,)

    return TorchClipDataset


def _unpickled(state: dict[str, Any]) -> ClipDataset:
    made: ClipDataset = _torch_class().__new__(_torch_class())
    made.__dict__.update(state)
    return made
