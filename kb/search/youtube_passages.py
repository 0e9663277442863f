"""Videos as passages: windows of the transcript that end where the talk pauses, and one passage of
title and description.
"""

from __future__ import annotations

import unicodedata
from bisect import bisect_left, bisect_right
from collections.abc import Iterator, Sequence
from itertools import accumulate
from pathlib import Path
from typing import Any, NamedTuple

import pyarrow as pa
import pyarrow.compute as pc

from kb.core.config.profile import Profile
from kb.search.passage import Passage, RowsByKey, batches, day, pieces, plain, rows

MOST = 120  # words of a window
LEAST = 60  # words before which no pause ends one
_CUE = ["start_s", "duration_s", "text"]
_VIDEO = ["video_id", "title", "description", "license", "published_at"]
_WATCH = "https://www.youtube.com/watch?v="


class Talk(NamedTuple):
    """What is said in a video, by cue: when it begins and ends (s), its text, words until there."""

    starts: list[float]
    ends: list[float]
    texts: list[str]
    words: list[int]

    def windows(self) -> Iterator[tuple[int, int]]:
        """The cues in groups (first, one past the last) of at most MOST words. A group ends before
        the longest pause after its first LEAST words; of equal pauses before the last.
        """
        words, begin, count = self.words, 0, len(self.texts)
        pauses = [
            round(start - end, 3) if start > end else 0.0
            for start, end in zip(self.starts[1:], self.ends, strict=False)
        ]  # after each cue but the last
        while begin < count:
            end = bisect_right(words, words[begin] + MOST, begin + 1) - 1
            if end < count:
                first = bisect_left(words, words[begin] + LEAST, begin + 1)
                some = pauses[first - 1 : end]
                while some[-1] < max(some):
                    some.pop()
                end = first + len(some) - 1
            yield begin, end
            begin = end


def passages(_: Profile, root: Path) -> Iterator[Passage]:
    """The passages of all kept videos, by video. Raises DamagedData."""
    heard = RowsByKey(spoken(root), "video_id")
    for video in rows(root, "youtube/videos", _VIDEO):
        key, title = video["video_id"], plain(video["title"])
        about = {
            "key": key,
            "thing": key,
            "title": title,
            "date": day(video["published_at"]),
            "licence": video["license"],
        }
        described = plain(video["description"]).splitlines()
        for text in list(pieces(described)) or [""]:
            yield Passage("video", text=text, url=f"{_WATCH}{key}", **about)
        for transcript in heard.of(key):
            speech: Talk = transcript["talk"]
            for begin, after in speech.windows():
                text, times = "\n".join(speech.texts[begin:after]), speech.starts[begin:after]
                url = f"{_WATCH}{key}&t={int(times[0])}s"
                yield Passage("transcript", text=text, url=url, times=times, **about)


def spoken(root: Path) -> Iterator[dict[str, Any]]:
    """`video_id` of each transcript and its `talk`, by video.

    Cues never become an object each: there are a hundred times as many as anything else.
    """
    for part in batches(root, "youtube/transcripts", ["video_id", "cues"]):
        keys, lists = part["video_id"].to_pylist(), part["cues"].combine_chunks()
        counts = pc.list_value_length(lists).to_pylist()
        starts, ends, texts = _columns(pc.list_flatten(lists))
        at = 0
        for key, count in zip(keys, counts, strict=True):
            after = at + (count or 0)
            yield {
                "video_id": key,
                "talk": _talk(starts[at:after], ends[at:after], texts[at:after]),
            }
            at = after


def _columns(cues: pa.Array[Any]) -> tuple[list[float], list[float], list[str]]:
    """Starts and ends of cues to the hundredth of a second, and their texts; no null."""
    start, length, text = (pc.struct_field(cues, [name]) for name in _CUE)
    starts = pc.max_element_wise(start, 0.0)  # which leaves nulls out
    ends = pc.add(starts, pc.max_element_wise(length, 0.0))
    return (
        pc.round(starts, 2).to_pylist(),
        pc.round(ends, 2).to_pylist(),
        pc.fill_null(text, "").to_pylist(),
    )


def talk(
    starts: Sequence[float | None], durations: Sequence[float | None], texts: Sequence[str | None]
) -> Talk:
    """The cues with words, none of them longer than a window: a longer one is divided by its words.

    Times in seconds.
    """
    columns: list[pa.Array[Any]] = [
        pa.array(starts, pa.float64()),
        pa.array(durations, pa.float64()),
        pa.array(texts, pa.string()),
    ]
    return _talk(*_columns(pa.StructArray.from_arrays(columns, names=_CUE)))


def _talk(starts: list[float], ends: list[float], texts: list[str]) -> Talk:
    joined = f" {' '.join(texts)} "
    one_form = joined.isascii() or unicodedata.is_normalized("NFC", joined)
    if one_form and joined.isprintable() and "  " not in joined:  # as nearly all are
        counts = [text.count(" ") + 1 for text in texts]
        if max(counts, default=0) <= MOST:
            return Talk(starts, ends, texts, list(accumulate(counts, initial=0)))
    words = [plain(text).split() for text in texts]
    counts = list(map(len, words))
    if counts and (min(counts) == 0 or max(counts) > MOST):
        starts, ends, words = _divided(starts, ends, words)
        counts = list(map(len, words))
    return Talk(starts, ends, list(map(" ".join, words)), list(accumulate(counts, initial=0)))


def _divided(
    begun: list[float], ended: list[float], words: list[list[str]]
) -> tuple[list[float], list[float], list[list[str]]]:
    """Cues without words left out, those of more than a window's in parts."""
    starts, ends, parts = [], [], []
    for start, end, cue_words in zip(begun, ended, words, strict=True):
        for at in range(0, len(cue_words), MOST):
            after = min(at + MOST, len(cue_words))
            starts.append(start + at / len(cue_words) * (end - start))
            ends.append(start + after / len(cue_words) * (end - start))
            parts.append(cue_words[at:after])
    return starts, ends, parts
