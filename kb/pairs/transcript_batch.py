"""Transcripts of a batch as one run of bytes, with the place and time of every cue.

A transcript's text is its cues in order of their start, with one space between two. Positions in
it are characters; inside a batch they are bytes. Times are whole milliseconds.

Captions also mark sounds and speakers: [Music], [Applause], notes, >> where the speaker changes.
Nobody says these marks, so spaces replace them, and positions stay those of the transcript.
"""

from __future__ import annotations

import re
from itertools import pairwise
from typing import Any, cast

import pyarrow as pa
import pyarrow.compute as pc

from kb.core.cached_property import cached_property
from kb.core.installation import np
from kb.pairs.matching import WALL

_WALL = b" " + bytes([WALL]) + b" "
_SPACES = bytes(0x20 if byte in b" \t\n\v\f\r\x1c\x1d\x1e\x1f" else byte for byte in range(256))
# Spaces beyond ASCII, as str.split() sees them
_WIDE_SPACE = (
    rb"\xc2[\x85\xa0]|\xe1\x9a\x80|\xe2\x80[\x80-\x8a\xa8\xa9\xaf]|\xe2\x81\x9f|\xe3\x80\x80"
)
# At most 64 bytes in brackets, so that one that never closes hides nothing. Each alternative begins
# with a literal: only then `re` looks for first bytes, six times faster than with `>{2,}`.
_SOUND = rb"\[[^\[\]\xff]{0,64}\]|>>+|\xe2\x99[\xa9-\xac]"  # ♩ ♪ ♫ ♬
_SPACE = re.compile(_WIDE_SPACE)
_NOT_SPOKEN = re.compile(_SOUND + b"|" + _WIDE_SPACE)
_LONGEST_WORD = 1_000  # ms; how long a word lasts after which nothing is said for a while
_FAR = 1e9  # seconds; greater times are not valid


class Text:
    """A batch of transcripts.

    `given` begins and ends with a space; `raw` is the same with plain spaces in place of sounds and
    white space. Arrays a
    cue: `cue_at` (first byte; a last one more for the end), `cue_start`, `cue_end` (ms),
    `cue_video`; arrays a video: `video_at`, `video_end` (bytes), `length` (ms), and Arrow columns
    `ids`, `kinds`.
    """

    def __init__(
        self,
        transcripts: pa.Table,
        lengths: pa.Array[Any] | None = None,
        channels: pa.ChunkedArray[Any] | None = None,
        *,
        known: np.ndarray | None = None,
        parted: bool = False,
    ) -> None:
        """`transcripts` has the columns of youtube/transcripts; `lengths` the videos' seconds and
        `channels` the ids of their channels, null when unknown. `known`: of which videos the topic
        is known (bool; by default of none). `parted`: these are texts, not captions, and no
        phrase reaches from one into the next.
        """
        transcripts = transcripts.combine_chunks()
        self.ids, self.kinds = _column(transcripts, "video_id"), _column(transcripts, "kind")
        self.channels: list[str | None] = (
            cast("list[str | None]", channels.to_pylist()) if channels else [None] * len(self.ids)
        )
        self.known = np.zeros(len(self.ids), bool) if known is None else known
        cues = _column(transcripts, "cues")
        videos = len(cues)
        counts = np.asarray(pc.fill_null(pc.list_value_length(cues), 0)).astype(np.int64)
        cells = pc.list_flatten(cues)
        texts = pc.fill_null(pc.struct_field(cells, "text"), "").cast(pa.large_binary())
        start, last = _seconds(cells, "start_s"), _seconds(cells, "duration_s")
        video = np.repeat(np.arange(videos), counts)
        starts = _word_starts(cells)
        if len(start) > 1 and ((start[1:] < start[:-1]) & (video[1:] == video[:-1])).any():
            order = np.lexsort((np.arange(len(start)), start, video))
            texts, start, last = texts.take(pa.array(order)), start[order], last[order]
            starts = starts.take(pa.array(order)) if starts is not None else None
        self.cue_video, self._starts = video, starts
        self._times(start, last, lengths)
        self._places(texts, counts, _WALL if parted else b" ")
        self.raw = _blanked(_SPACE if parted else _NOT_SPOKEN, self.given)

    def _times(self, start: np.ndarray, last: np.ndarray, lengths: pa.Array[Any] | None) -> None:
        """A cue of an automatic track is over when the next begins;
        nothing lasts longer than its video.
        """
        end = start + np.maximum(last, 0)
        video, videos = self.cue_video, len(self.ids)
        if len(start) > 1:
            automatic = ~np.asarray([kind == "manual" for kind in self.kinds.to_pylist()], bool)
            follows = np.flatnonzero((video[1:] == video[:-1]) & automatic[video[1:]])
            end[follows] = np.minimum(end[follows], start[follows + 1])
        start, end = self._stretched(start, end)
        spoken = np.zeros(videos, np.int64)
        np.maximum.at(spoken, video, end)
        length = spoken
        if lengths is not None:
            seconds = pc.fill_null(lengths.cast(pa.float64()), 0)
            given = np.asarray(seconds.to_numpy(zero_copy_only=False))
            given = np.where(np.isfinite(given) & (given > 0) & (given < _FAR), given, 0)
            length = np.where(given > 0, np.floor(given * 1000 + 1e-6).astype(np.int64), spoken)
        self.length = length
        limit = length[video]
        self.beyond = start >= limit  # cues that begin when the video is over
        self.cue_start, self.cue_end = np.minimum(start, limit), np.minimum(end, limit)

    def _stretched(self, start: np.ndarray, end: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Cues that hold all their words, the last one until the next cue begins but at most a
        second; none is without a length.
        """
        last = start.copy()
        if self._starts is not None and len(start):
            parents = np.asarray(pc.list_parent_indices(self._starts)).astype(np.int64)
            words = _ms(pc.list_flatten(self._starts))
            np.maximum.at(last, parents, words)
            early = start.copy()
            np.minimum.at(early, parents, words)
        else:
            early = start
        following = np.append(start[1:], 0)
        following[np.append(self.cue_video[1:] != self.cue_video[:-1], True)[: len(start)]] = 0
        until = last + _LONGEST_WORD
        until = np.where(following > last, np.minimum(until, following), until)
        return early, np.where(end <= last, until, end)

    def _places(self, texts: pa.Array[Any], counts: np.ndarray, joint: bytes) -> None:
        """Join cues by a joint and transcripts by a wall, and note where each begins."""
        videos = len(counts)
        sizes = np.asarray(pc.binary_length(texts)).astype(np.int64)
        starts = np.concatenate(([0], np.cumsum(counts)))
        byte_ends = np.concatenate(([0], np.cumsum(sizes)))
        joints = np.maximum(counts - 1, 0)
        spoken = byte_ends[starts[1:]] - byte_ends[starts[:-1]] + joints * len(joint)
        self._walls = max(videos - 1, 0) + (int(joints.sum()) if joint == _WALL else 0)
        self.video_at = 1 + np.concatenate(([0], np.cumsum(spoken + len(_WALL))))[:videos]
        self.video_end = self.video_at + spoken
        within = byte_ends[:-1] + np.arange(len(sizes)) * len(joint)
        first = np.minimum(starts[:-1], max(len(within) - 1, 0))
        base = within[first] if len(within) else np.zeros(videos, np.int64)
        self.cue_at = self.video_at[self.cue_video] + within - np.repeat(base, counts)
        self.cue_size = sizes
        together = pc.binary_join(
            pa.LargeListArray.from_arrays(pa.array(starts, pa.int64()), texts),
            pa.scalar(joint, pa.large_binary()),
        )
        data = memoryview(together.buffers()[2] or b"")
        ends = np.cumsum(np.asarray(pc.binary_length(together)), dtype=np.int64).tolist()
        pieces: list[bytes | memoryview] = [b" "]
        for begin, end in pairwise([0, *ends]):
            pieces += [data[begin:end], _WALL]
        # Copied once; no wall stands behind the last one.
        pieces[-1:] = [b" "] if videos else [b" ", b" "]
        self.given: bytes = b"".join(pieces)

    def __len__(self) -> int:
        return len(self.ids)

    def transcript(self, video: int) -> str:
        """The whole text of a transcript, sounds among it."""
        text = self.given[self.video_at[video] : self.video_end[video]]
        return text.decode("utf-8", "replace")

    def cue_of(self, places: np.ndarray) -> np.ndarray:
        """The cue that holds each byte."""
        return np.searchsorted(self.cue_at, places, "right") - 1

    def video_of(self, places: np.ndarray) -> np.ndarray:
        """The video that holds each byte."""
        return np.searchsorted(self.video_at, places, "right") - 1

    @cached_property
    def codes(self) -> np.ndarray:
        return np.frombuffer(self.raw, np.uint8)

    @cached_property
    def _inner(self) -> np.ndarray:
        """Where bytes are that continue a character."""
        codes = np.frombuffer(self.given, np.uint8)
        return np.flatnonzero((codes & 0xC0) == 0x80)

    def characters(self, places: np.ndarray, videos: np.ndarray) -> np.ndarray:
        """Bytes of the batch as characters of their transcript's text."""
        begin = self.video_at[videos]
        bytes_: np.ndarray = places - begin
        if not len(self._inner):
            return bytes_
        inner = np.searchsorted(self._inner, places) - np.searchsorted(self._inner, begin)
        return bytes_ - inner

    @cached_property
    def words(self) -> np.ndarray:
        """First byte of each word (walls between transcripts are among them)."""
        space = self.codes == 0x20
        return np.flatnonzero(space[:-1] & ~space[1:]) + 1

    def before(self, places: np.ndarray) -> np.ndarray:
        """How many words begin before each byte."""
        return np.searchsorted(self.words, places)

    def word_of(self, places: np.ndarray) -> np.ndarray:
        """The number of the word that holds each byte."""
        return self.before(places + 1) - 1

    def timed(self, places: np.ndarray) -> np.ndarray:
        """Whether the words that hold these bytes have times of their own."""
        return self._word_times(places)[0] >= 0

    def _word_times(self, places: np.ndarray) -> np.ndarray:
        """When the words that hold these bytes begin and end (two rows, ms), -1 where their cues
        have no word times.

        Word times are those of words as captions write them, marks of sounds and speakers too. A
        word ends when the next one of its cue begins, the last one with the cue, and none takes
        longer than a second. Words stay inside their video.
        """
        if self._starts is None or not len(places):
            return np.full((2, len(places)), -1)
        cues, cue = np.unique(self.cue_of(places), return_inverse=True)
        begins, words = self._captions(cues)
        first = np.searchsorted(words, begins)
        counts = np.diff(first, append=len(words))
        given = self._starts.take(pa.array(cues))
        sizes = np.asarray(pc.fill_null(pc.list_value_length(given), -1))
        usable = (counts > 0) & (sizes == counts)  # a time for each word
        starts = _ms(pc.list_flatten(given.filter(pa.array(usable))))
        of_cue = np.repeat(cues[usable], counts[usable])
        # Of several words at one moment each ends when the next moment's begins.
        moments = of_cue * round(_FAR * 1000) + starts
        next_ = np.searchsorted(moments, moments, "right")
        low, high = self.cue_start[of_cue], self.cue_end[of_cue]
        is_last = np.append(of_cue, -1)[next_] != of_cue
        ends = np.where(is_last, high, np.append(starts, 0)[next_])
        times = np.full((2, len(words)), -1)
        times[:, np.repeat(usable, counts)] = (
            np.clip(starts, low, high),
            np.clip(np.minimum(ends, starts + _LONGEST_WORD), low, high),
        )
        in_captions = places - self.cue_at[cues][cue] + begins[cue]
        return times[:, np.searchsorted(words, in_captions, "right") - 1]

    def _captions(self, cues: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Of the captions of these cues alone, one after the other: the byte with which each of
        them begins, and those with which their words begin.
        """
        sizes = self.cue_size[cues] + 1  # with the space that follows
        begins = 1 + np.cumsum(sizes) - sizes  # after a space
        places = np.repeat(self.cue_at[cues] - begins, sizes) + np.arange(1, sizes.sum() + 1)
        captions = np.frombuffer(self.given, np.uint8)[np.append(0, places)]
        space = np.frombuffer(_blanked(_SPACE, captions.tobytes()), np.uint8) == 0x20
        return begins, np.flatnonzero(space[:-1] & ~space[1:]) + 1

    def time_of(self, places: np.ndarray, *, after: bool = False) -> np.ndarray:
        """When the words that hold these bytes begin (or end, with `after`), in ms: by the times of
        words where the cue has them, else its time is shared out evenly among its words.
        """
        known = self._word_times(places)[int(after)]
        return np.where(known >= 0, known, self.shared_out(places, after=after))

    def shared_out(self, places: np.ndarray, *, after: bool = False) -> np.ndarray:
        """The same by the times of cues alone."""
        cue = self.cue_of(places)
        begin = self.cue_at[cue]
        bounds = np.concatenate((places + 1, begin, begin + self.cue_size[cue]))
        number, first, behind = np.split(self.before(bounds), 3)
        span, count = self.cue_end[cue] - self.cue_start[cue], behind - first
        spoken = np.minimum(number - 1 - first + after, count)
        return self.cue_start[cue] + span * spoken // np.maximum(count, 1)

    @cached_property
    def words_per_second(self) -> np.ndarray:
        """Spoken words of each video by its length; NaN where it has none."""
        words = self.before(self.video_end) - self.before(self.video_at)
        seconds = np.where(self.length > 0, self.length / 1000, np.nan)
        rate: np.ndarray = words / seconds
        return rate

    @property
    def word_count(self) -> int:
        return max(0, len(self.words) - self._walls)


def without_sounds(captions: bytes) -> bytes:
    """UTF-8 text with spaces, byte for byte, in place of sounds, changes of speakers and white
    space.
    """
    return _blanked(_NOT_SPOKEN, captions)


def _blanked(pattern: re.Pattern[bytes], text: bytes) -> bytes:
    return pattern.sub(lambda match: b" " * len(match[0]), text).translate(_SPACES)


def _column(rows: pa.Table, name: str) -> pa.Array[Any]:
    column = rows.column(name)
    if not column.num_chunks:
        return cast("pa.Array[Any]", pa.array([], column.type))
    return cast("pa.Array[Any]", column.chunk(0))  # the stubs say ChunkedArray


def _word_starts(cells: pa.Array[Any]) -> pa.Array[Any] | None:
    """Lists of the starts of words (s) of each cue; None where transcripts have none, as those of
    older data.
    """
    if cells.type.get_field_index("word_start_s") < 0:
        return None
    starts = cast("pa.Array[Any]", pc.struct_field(cells, "word_start_s"))
    return starts if starts.null_count < len(starts) else None


def _seconds(cells: pa.Array[Any], name: str) -> np.ndarray:
    """A field of cues in ms; what is no time (null, NaN, infinite) counts as 0."""
    return _ms(pc.struct_field(cells, name))


def _ms(seconds: Any) -> np.ndarray:
    """Seconds as whole ms."""
    values = seconds.cast("float64").fill_null(0).to_numpy(zero_copy_only=False)
    values = np.where(np.isfinite(values) & (np.abs(values) < _FAR), values, 0)
    return np.rint(np.maximum(values, 0) * 1000).astype(np.int64)
