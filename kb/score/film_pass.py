"""One pass over a film: every frame is decoded once, for shots, motion and a model's vectors.

What FFmpeg can't decode is left out, and decoding goes on behind it; a film that ends early counts
as far as it goes. Memory holds the pictures of some seconds, however long the film is.
"""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Iterator, Sequence
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from fractions import Fraction
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple, Self

from kb.clips.frames import LEAD_S, UndecodableVideo, check_film, decoding_error, fitted
from kb.core import signals
from kb.core.engine import Inline
from kb.core.installation import np
from kb.score.models import BATCH
from kb.score.shots import HEIGHT, WIDTH, Shot, ShotFinder

if TYPE_CHECKING:
    import av

    from kb.score.models import ClipModel

_AHEAD = 2  # batches that wait for a model on a GPU while frames are decoded
SAMPLE_S = 1.0  # from one picture to the next of those that motion is measured of


class Watched(NamedTuple):
    """What a pass found. `damaged`: packets that could not be decoded; `model_s` and `pass_s`: how
    long the model computed, and the whole pass took (s).

    motion   float32 [seconds]: of the picture in the middle of each second, the mean difference of
             its values (0 to 255) from the picture a second later; nan where one is missing
    light    float32 [seconds]: its mean value; nan where there is none
    ticks    int64 [frames]: the places on the model's grid that the film has of those wanted
    vectors  float16 [frames, width]
    """

    end_s: float
    shots: list[Shot]
    motion: np.ndarray
    light: np.ndarray
    ticks: np.ndarray
    vectors: np.ndarray
    damaged: int
    model_s: float = 0.0
    pass_s: float = 0.0


def watch_film(
    path: Path, ticks: Sequence[int], model: ClipModel | None, *, ahead: bool = False
) -> Watched:
    """Decode a film once. `ticks`, ascending: the places of the model's grid, (tick + ½) · step_s,
    that a vector is wanted of. `ahead`: frames are decoded while the model computes, for a model
    that is not on this processor.

    Raises UndecodableVideo where no frame can be decoded, FileNotFoundError, Interrupted.
    """
    begin = time.perf_counter()
    finder, sampler = ShotFinder(), _Sampler()
    embedder = _Embedder(ticks, model, ahead=ahead)
    decoder = _Decoder(path)
    end_s = 0.0
    with embedder:
        for time_s, until_s, frame in decoder.frames():
            small = frame.reformat(
                width=WIDTH, height=HEIGHT, format="bgr24", interpolation="FAST_BILINEAR", threads=1
            ).to_ndarray()
            finder.take(time_s, small)
            sampler.take(time_s, until_s, small)
            embedder.take(time_s, until_s, frame)
            end_s = until_s
        if not end_s:
            raise UndecodableVideo(decoder.why or "no frame can be decoded")
        motion, light = sampler.seconds()
        taken, vectors = embedder.vectors()
    shots, took = finder.shots(end_s), time.perf_counter() - begin
    return Watched(
        end_s, shots, motion, light, taken, vectors, decoder.damaged, embedder.model_s, took
    )


class _Decoder:
    """The frames of a film's first picture stream that is no cover."""

    def __init__(self, path: Path) -> None:
        check_film(path)
        self._path = path
        self.damaged, self.why = 0, ""

    def frames(self) -> Iterator[tuple[float, float, av.VideoFrame]]:
        """Each frame with the time at which it is shown, and that at which the next one is (s)."""
        import av  # noqa: PLC0415  belongs to the extra `films`

        try:
            with av.open(str(self._path), metadata_errors="ignore") as film:
                cover = av.stream.Disposition.attached_pic
                videos = [video for video in film.streams.video if not video.disposition & cover]
                if not videos or videos[0].time_base is None:
                    raise UndecodableVideo("no video stream")
                stream = videos[0]
                stream.codec_context.thread_count = 1  # as in kb.clips.frames
                start = Fraction(max(film.start_time or 0, 0), av.time_base)
                yield from self._timed(film, stream, start)
        except (av.FFmpegError, ValueError) as error:
            self.why = decoding_error(error)

    def _timed(
        self, film: av.container.InputContainer, stream: av.VideoStream, start: Fraction
    ) -> Iterator[tuple[float, float, av.VideoFrame]]:
        base = Fraction(stream.time_base or 1)
        before: av.VideoFrame | None = None
        shown = 0.0
        for frame in self._decoded(film, stream):
            if frame.pts is None or (before is not None and frame.pts <= (before.pts or 0)):
                continue
            at = max(0.0, float(frame.pts * base - start))
            if before is None:
                shown = 0.0 if at <= LEAD_S else at
            else:
                yield shown, at, before
                shown = at
            before = frame
        if before is not None:
            rate = stream.average_rate
            length = (before.duration or 0) * base or (1 / rate if rate else base)
            yield shown, shown + float(length), before

    def _decoded(
        self, film: av.container.InputContainer, stream: av.VideoStream
    ) -> Iterator[av.VideoFrame]:
        import av  # noqa: PLC0415  belongs to the extra `films`

        packets = film.demux(stream)
        while True:
            try:
                packet = next(packets, None)
            except av.FFmpegError as error:  # the file ends too early: what came before counts
                self.why, packet = decoding_error(error), None
            signals.stop.raise_if_asked()
            try:
                yield from stream.codec_context.decode(packet)
            except av.EOFError:
                return
            except av.InvalidDataError as error:
                self.damaged, self.why = self.damaged + 1, decoding_error(error)
            if packet is None:
                return


class _Sampler:
    """The pictures in the middle of each second, one by one."""

    def __init__(self) -> None:
        self._motion, self._light = list[float](), list[float]()
        self._last: np.ndarray | None = None

    def take(self, time_s: float, until_s: float, small: np.ndarray) -> None:
        while (len(self._light) + 0.5) * SAMPLE_S < time_s:  # the picture has not begun
            self._sample(None)
        while (len(self._light) + 0.5) * SAMPLE_S < until_s:
            self._sample(small)

    def _sample(self, small: np.ndarray | None) -> None:
        image = None if small is None else small.astype(np.int16)
        if self._light:
            apart = np.nan
            if image is not None and self._last is not None:
                apart = float(np.abs(image - self._last).mean())
            self._motion.append(apart)
        self._light.append(np.nan if image is None else float(image.mean()))
        self._last = image

    def seconds(self) -> tuple[np.ndarray, np.ndarray]:
        """motion and light of `Watched`."""
        motion = [*self._motion, np.nan][: len(self._light)]
        return np.array(motion, np.float32), np.array(self._light, np.float32)


class _Embedder:
    """Takes the frames at the places of a model's grid, and embeds them in batches; `ahead`: in a
    thread, while the next frames come.
    """

    def __init__(self, ticks: Sequence[int], model: ClipModel | None, *, ahead: bool) -> None:
        self._ticks, self._model, self._place = list(ticks), model, 0
        self._taken, self._batch = list[int](), list[np.ndarray]()
        self._vectors, self.model_s = list[np.ndarray](), 0.0
        self._runner: Executor = ThreadPoolExecutor(1) if ahead else Inline()
        self._waiting = deque[Future[np.ndarray]]()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._runner.shutdown(cancel_futures=True)

    def take(self, time_s: float, until_s: float, frame: av.VideoFrame) -> None:
        if self._model is None:
            return
        image: np.ndarray | None = None
        while self._place < len(self._ticks):
            tick = self._ticks[self._place]
            at = (tick + 0.5) * self._model.step_s
            if at >= until_s:
                return
            self._place += 1
            if at < time_s:
                # What a player shows before the picture begins.
                self._add(tick, np.zeros((*self._model.size, 3), np.uint8))
                continue
            image = fitted(frame, self._model.size, self._model.fit) if image is None else image
            self._add(tick, image)

    def _add(self, tick: int, image: np.ndarray) -> None:
        self._taken.append(tick)
        self._batch.append(image)
        if len(self._batch) == BATCH:
            self._embed()

    def _embed(self) -> None:
        if self._batch:
            self._waiting.append(self._runner.submit(self._embedded, self._batch))
        self._batch = []
        self._collect(_AHEAD)

    def _collect(self, left: int) -> None:
        while len(self._waiting) > left:
            self._vectors.append(self._waiting.popleft().result())

    def _embedded(self, batch: list[np.ndarray]) -> np.ndarray:
        begin = time.perf_counter()
        assert self._model is not None
        vectors: np.ndarray = self._model.frames(batch).astype(np.float16)
        self.model_s += time.perf_counter() - begin
        return vectors

    def vectors(self) -> tuple[np.ndarray, np.ndarray]:
        """The places that were taken, and their vectors."""
        self._embed()
        self._collect(0)
        empty = np.zeros((0, 0), np.float16)
        vectors = np.concatenate(self._vectors) if self._vectors else empty
        return np.array(self._taken, np.int64), vectors
