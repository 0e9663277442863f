"""Videos as passages: windows of the transcript that end where the talk pauses, and one passage of
title and description.
"""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import pyarrow.compute as pc

from kb.core import scripts
from kb.core.config.profile import Profile
from kb.search.passage import Passage, batches, day, pieces, plain, rows
from kb.store.tables.merge import RowsByKey

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
        for transcript in heard.rows_of(key):
            speech: Talk = transcript["talk"]
            for begin, after in speech.windows():
                text, times = "\n".join(speech.texts[begin:after]), speech.starts[begin:after]
                url = f"{_WATCH}{key}&t={int(times[0])}s"
                yield Passage("transcript", text=text, url=url, times=times, **about)


def spoken(root: Path) -> Iterator[dict[str, Any]]:
    """`video_id` of each transcript and its `talk`, by video."""
    for part in batches(root, "youtube/transcripts", ["video_id", "cues"]):
        lists = part["cues"].combine_chunks()
        counts = pc.list_value_length(lists).to_pylist()
        cues = pc.list_flatten(lists)
        columns = [pc.struct_field(cues, [name]).to_pylist() for name in _CUE]
        at = 0
        for key, count in zip(part["video_id"].to_pylist(), counts, strict=True):
            after = at + (count or 0)
            yield {"video_id": key, "talk": talk(*(column[at:after] for column in columns))}
            at = after


def talk(
    starts: Sequence[float | None], durations: Sequence[float | None], texts: Sequence[str | None]
) -> Talk:
    """The cues with words. A cue longer than a window is divided. Times in seconds."""
    made = Talk([], [], [], [0])
    for start, duration, text in zip(starts, durations, texts, strict=True):
        divided = scripts.parts(plain(text), MOST)
        words = sum(count for _, count in divided)
        begun, length = max(start or 0.0, 0.0), max(duration or 0.0, 0.0)
        at = 0
        for part, count in divided:
            made.starts.append(round(begun + at / words * length, 2))
            at += count
            made.ends.append(round(begun + at / words * length, 2))
            made.texts.append(part)
            made.words.append(made.words[-1] + count)
    return made
