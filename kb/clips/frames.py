"""The frames that a film shows at given times, by presentation time.

Times are those of the film: a container whose clock begins later, as that of most `.ts` and `.mpg`
files, has its start time added. The frame at time t is the one with the largest presentation time
that is not after t, in ticks of the stream, so no time is rounded. In the second before the first
frame the first one is shown; a picture that begins later than that is not there yet. Packets are
read in order, and of the groups of pictures only those are decoded that show a wanted frame; gaps
are skipped by a seek.
"""

from __future__ import annotations

import math
import os
from collections.abc import Iterator, Sequence
from fractions import Fraction
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from kb.core.installation import np
from kb.core.regular_file import check_regular

if TYPE_CHECKING:
    import av

Fit = Literal["stretch", "crop", "pad"]
LEAD_S = 1  # s; so much later than the first sound the first picture begins in many films
_GAP = 20  # s; a longer gap is skipped by a seek, a shorter one by reading packets


class UndecodableVideo(Exception):
    """A file without a video stream, or one that FFmpeg can't decode; its text says which."""


def decoding_error(error: av.FFmpegError | ValueError) -> str:
    """What libav says, without the path of the film, which is nobody else's business."""
    return getattr(error, "strerror", None) or str(error)


def check_film(path: Path) -> os.stat_result:
    """What `os.stat` says of a file, before libav opens it, which would read a device as well, and
    wait for a FIFO. Raises UndecodableVideo for what is no regular file or can't be read,
    FileNotFoundError where nothing is.
    """
    try:
        return check_regular(path)
    except FileNotFoundError:
        raise
    except OSError as error:
        raise UndecodableVideo(str(error.strerror)) from None


def frames_at(
    path: Path,
    times_s: Sequence[float],
    size: tuple[int, int] = (160, 256),
    fit: Fit = "stretch",
) -> Iterator[np.ndarray | None]:
    """The frame shown at each time (s, ascending): uint8 [height, width, 3], RGB, upright; None
    where the picture has not begun.

    `size`: height and width. `fit`: stretch changes the ratio of the sides, crop cuts what is
    beyond the middle, pad adds black. Ends early where the film does. Raises UndecodableVideo,
    FileNotFoundError.
    """
    import av  # noqa: PLC0415  belongs to the extra `clips`

    check_film(path)
    try:
        with av.open(str(path), metadata_errors="ignore") as film:
            if not film.streams.video:
                raise UndecodableVideo("no video stream")
            stream = film.streams.video[0]
            # Films are decoded side by side by other processes; threads would cost a quarter more.
            stream.codec_context.thread_count = 1
            shown, image = None, np.zeros((0, 0, 3), np.uint8)
            start = Fraction(max(film.start_time or 0, 0), av.time_base)
            for frame in _shown(film, stream, _ticks(times_s, start, stream)):
                if frame is None:
                    yield None
                    continue
                if frame is not shown:
                    shown, image = frame, fitted(frame, size, fit)
                yield image
    except (av.FFmpegError, ValueError) as error:
        raise UndecodableVideo(decoding_error(error)) from None


def _ticks(times_s: Sequence[float], start: Fraction, stream: av.VideoStream) -> list[int]:
    """The last tick of the stream that is not after each time since `start`."""
    base = stream.time_base
    if base is None:
        raise UndecodableVideo("no time base")
    return [math.floor((Fraction(time) + start) / base) for time in times_s]


def _shown(
    film: av.container.InputContainer, stream: av.VideoStream, ticks: Sequence[int]
) -> Iterator[av.VideoFrame | None]:
    """The frame shown at each tick, until the film ends; None where the picture has not begun."""
    lead = LEAD_S / float(stream.time_base or 1)
    left = list(reversed(ticks))
    last: av.VideoFrame | None = None
    frames = _decoded(film, stream, left)
    while left and (frame := next(frames, None)) is not None:
        if frame.pts is None:
            raise UndecodableVideo("frames without times")
        while left and left[-1] < frame.pts:
            is_early = last is None and frame.pts - left[-1] > lead
            yield None if is_early else last or frame
            left.pop()
        last = frame
    end = (last.pts or 0) + max(last.duration or 0, 1) if last is not None else 0
    while left and last is not None and left[-1] < end:
        yield last
        left.pop()


def _decoded(
    film: av.container.InputContainer, stream: av.VideoStream, left: list[int]
) -> Iterator[av.VideoFrame]:
    """Frames in the order of their times, of the groups of pictures that show `left[-1]`, the next
    tick that is wanted; the caller takes it off when it has its frame.

    A group is decoded once it is known that the next one begins after the wanted tick.
    """
    waiting: list[av.Packet[av.VideoStream]] = []
    decoding, key = False, -math.inf
    for packet in _packets(film, stream, left):
        pts = packet.pts
        if packet.is_keyframe and pts is not None and pts <= left[-1]:
            if decoding:
                stream.codec_context.flush_buffers()
            waiting, decoding, key = [packet], False, float(pts)
            continue
        waiting.append(packet)
        # No later packet is shown before its own decoding time.
        late = packet.dts is None or packet.dts > left[-1]
        decoding = decoding or packet.is_keyframe or late
        if decoding:
            for one in waiting:
                for frame in stream.codec_context.decode(one):
                    # Of an open group the frames before its key frame lack what they refer to.
                    if frame.pts is None or frame.pts >= key:
                        yield frame
            waiting = []


def _packets(
    film: av.container.InputContainer, stream: av.VideoStream, left: list[int]
) -> Iterator[av.Packet[av.VideoStream]]:
    """Packets in the order of the file, the last one empty; a gap before the wanted tick is skipped
    where the file can be sought in.
    """
    gap = _GAP / float(stream.time_base or 1)
    can_seek, sought, at = True, None, stream.start_time or 0
    packets = film.demux(stream)
    while True:
        if can_seek and left[-1] - at > gap and sought != left[-1]:
            sought = left[-1]
            film.seek(sought, stream=stream)
            packet = next(packets)
            if packet.pts is None or packet.pts > sought or not packet.is_keyframe:
                can_seek = False
                film.seek(min(0, stream.start_time or 0), stream=stream)
                packet = next(packets)
        else:
            following = next(packets, None)
            if following is None:
                return
            packet = following
        at = packet.dts if packet.dts is not None else at
        yield packet


def fitted(frame: av.VideoFrame, size: tuple[int, int], fit: Fit) -> np.ndarray:
    """A frame as RGB, upright, in the wanted size."""
    turns = round(frame.rotation / 90) % 4  # counterclockwise
    height, width = size
    shape = (frame.height, frame.width) if turns % 2 == 0 else (frame.width, frame.height)
    ratios = height / shape[0], width / shape[1]
    if fit == "stretch":
        inner = size
    else:
        ratio = max(ratios) if fit == "crop" else min(ratios)
        inner = max(1, round(shape[0] * ratio)), max(1, round(shape[1] * ratio))
    sides = inner if turns % 2 == 0 else inner[::-1]
    scaled = frame.reformat(
        height=sides[0], width=sides[1], format="rgb24", interpolation="AREA"
    ).to_ndarray()
    image = np.rot90(scaled, turns)
    top, left = (inner[0] - height) // 2, (inner[1] - width) // 2
    if fit == "pad":
        made = np.zeros((height, width, 3), np.uint8)
        made[-top : inner[0] - top, -left : inner[1] - left] = image
        return made
    if fit == "crop":
        image = image[top : top + height, left : left + width]
    return np.ascontiguousarray(image)
