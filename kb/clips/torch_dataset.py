"""Clips as a PyTorch dataset."""

from __future__ import annotations

import hashlib
import warnings
from collections import Counter
from collections.abc import Iterator
from functools import cache
from typing import Any, cast

import pyarrow as pa

from kb.clips.clip_files import NOT_ALIGNED
from kb.clips.clip_sources import ClipSource, NoClip
from kb.clips.film_lookup import MISSING
from kb.core.cached_property import cached_property
from kb.core.errors import UsageError
from kb.core.installation import np, torch
from kb.pairs.clip_tokens import token_ids
from kb.pairs.seeded_random import bits, video_keys


class ClipDataset:
    """Clips in an order that depends on seed and epoch, split over ranks and DataLoader workers.

    A clip is a dictionary: `video` (uint8 [frames, 3, height, width], RGB), `tokens` (int64 [77],
    CLIP's ids, padded with 0), `text`, `keyword`, `pair_id`, `video_id`, `frame_times_s` (float64
    [frames]). Each epoch has every clip once over all ranks and workers; ranks differ by one clip
    at most. A clip that can't be read is left out with a warning that says why.

    `left_out` counts the pairs that have no file ("missing"), one that is not their video
    ("film_differs") or does not open ("undecodable"), no text ("no_text") or no times
    ("not_aligned"). A warning for each such file says why.
    """

    def __init__(
        self, rows: pa.Table, source: ClipSource, *, seed: int, rank: int, world_size: int
    ) -> None:
        """`rows`: pair_id, video_id, keyword, text, clip_start_s and clip_end_s of pairs.

        Raises UsageError for a wrong rank, or if no pair has both a text and a file.
        """
        if not 0 <= rank < world_size:
            raise UsageError(f"rank is {rank}", hint=f"a number from 0 to {world_size - 1}")
        reasons, refused = list[str](), dict[str, str]()
        for batch in rows.to_batches():
            for row in batch.to_pylist():
                reason, what = source.lack(row) or ("", "")
                if reason not in ("", MISSING):
                    refused[row["video_id"]] = what
                if row["text"] is None or row["clip_start_s"] is None:
                    reason = "no_text" if row["text"] is None else NOT_ALIGNED
                reasons.append(reason)
        for video_id, what in refused.items():
            warnings.warn(f"video {video_id} has no clips: {what}", stacklevel=2)
        self.left_out = Counter(one for one in reasons if one)
        self._rows = rows.filter(pa.array([not one for one in reasons]))
        if not self._rows.num_rows:
            if self.left_out["no_text"]:
                raise UsageError("the pairs have no text", hint="`kb restore` brings it back")
            if self.left_out[NOT_ALIGNED]:
                raise UsageError("no pair with a file is alignable enough")
            raise UsageError(
                "no pair has a video file",
                hint=next(iter(refused.values()), "files are found by id, such as ID.mp4"),
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
