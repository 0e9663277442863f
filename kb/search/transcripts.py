"""Videos as passages: windows of the transcript that end where the talk pauses, and one passage of
title and description.
"""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from collections.abc import Iterator, Sequence
from itertools import accumulate
from pathlib import Path
from typing import Any, NamedTuple

import pyarrow.compute as pc

from kb.search.passage import Beside, Passage, batches, day, pieces, plain, rows

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
        begin, count = 0, len(self.texts)
        while begin < count:
            end = bisect_right(self.words, self.words[begin] + MOST, begin + 1) - 1
            best, pause = end, -1.0
            if end < count:
                first = bisect_left(self.words, self.words[begin] + LEAST, begin + 1)
                for after in range(first, end + 1):
                    gap = max(0.0, round(self.starts[after] - self.ends[after - 1], 3))
                    if gap >= pause:
                        best, pause = after, gap
            yield begin, best
            begin = best

    def joined(self, begin: int, after: int) -> tuple[str, list[tuple[int, float]]]:
        """A group's text, and where in it which second begins."""
        texts = self.texts[begin:after]
        at = accumulate((len(text) + 1 for text in texts), initial=0)
        return " ".join(texts), [
            (place, round(start, 2))
            for place, start in zip(at, self.starts[begin:after], strict=False)
        ]


def passages(root: Path) -> Iterator[Passage]:
    """The passages of all kept videos, by video. Raises DamagedData."""
    heard = Beside(spoken(root), "video_id")
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
            said: Talk = transcript["talk"]
            for begin, after in said.windows():
                text, times = said.joined(begin, after)
                url = f"{_WATCH}{key}&t={int(said.starts[begin])}s"
                yield Passage("transcript", text=text, url=url, times=times, **about)


def spoken(root: Path) -> Iterator[dict[str, Any]]:
    """`video_id` of each transcript and its `talk`, by video.

    Cues never become an object each: there are a hundred times as many as anything else.
    """
    for part in batches(root, "youtube/transcripts", ["video_id", "cues"]):
        keys, lists = part["video_id"].to_pylist(), part["cues"].combine_chunks()
        counts = pc.list_value_length(lists).to_pylist()
        cues = pc.list_flatten(lists)
        columns = [pc.struct_field(cues, [name]).to_pylist() for name in _CUE]
        at = 0
        for key, count in zip(keys, counts, strict=True):
            after = at + (count or 0)
            yield {"video_id": key, "talk": talk(*(one[at:after] for one in columns))}
            at = after


def talk(
    starts: Sequence[float | None], durations: Sequence[float | None], texts: Sequence[str | None]
) -> Talk:
    """The cues with words, none of them longer than a window: a longer one is divided by its words.

    Times in seconds.
    """
    begun = [max(0.0, start or 0.0) for start in starts]
    ended = [
        start + max(0.0, length or 0.0) for start, length in zip(begun, durations, strict=True)
    ]
    said = [text or "" for text in texts]
    if not "".join(said).isprintable():
        said = list(map(plain, said))
    words = list(map(str.split, said))
    counts = list(map(len, words))
    if counts and (min(counts) == 0 or max(counts) > MOST):
        begun, ended, words = _divided(begun, ended, words)
        counts = list(map(len, words))
    return Talk(begun, ended, list(map(" ".join, words)), list(accumulate(counts, initial=0)))


def _divided(
    begun: list[float], ended: list[float], words: list[list[str]]
) -> tuple[list[float], list[float], list[list[str]]]:
    """Cues without words left out, those of more than a window's in parts."""
    starts, ends, parts = [], [], []
    for start, end, said in zip(begun, ended, words, strict=True):
        for at in range(0, len(said), MOST):
            after = min(at + MOST, len(said))
            starts.append(start + at / len(said) * (end - start))
            ends.append(start + after / len(said) * (end - start))
            parts.append(said[at:after])
    return starts, ends, parts
