"""Videos as passages: windows of the transcript that end where the talk pauses, and one passage of
title and description.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from kb.search.passage import Beside, Passage, day, pieces, plain, rows

MOST = 120  # words of a window
LEAST = 60  # words before which no pause ends one
_VIDEO = ["video_id", "title", "description", "license", "published_at"]
_WATCH = "https://www.youtube.com/watch?v="


class Cue(NamedTuple):
    """Words that are shown together, from `start_s` to `end_s`, and how many they are."""

    start_s: float
    end_s: float
    text: str
    words: int


def passages(root: Path) -> Iterator[Passage]:
    """The passages of all kept videos, by video. Raises DamagedData."""
    spoken = Beside(rows(root, "youtube/transcripts", ["video_id", "cues"]), "video_id")
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
        for transcript in spoken.of(key):
            for window in windows(list(cues(transcript["cues"] or ()))):
                text, times = joined(window)
                url = f"{_WATCH}{key}&t={int(window[0].start_s)}s"
                yield Passage("transcript", text=text, url=url, times=times, **about)


def cues(given: Sequence[dict[str, Any]]) -> Iterator[Cue]:
    """Cues with words, none of them longer than a window: a longer one is divided by its words."""
    for one in given:
        text = one["text"] or ""
        words = (text if text.isprintable() else plain(text)).split()
        start, length = max(0.0, one["start_s"] or 0.0), max(0.0, one["duration_s"] or 0.0)
        for at in range(0, len(words), MOST):
            part = words[at : at + MOST]
            first, last = at / len(words), (at + len(part)) / len(words)
            yield Cue(start + first * length, start + last * length, " ".join(part), len(part))


def windows(spoken: Sequence[Cue]) -> Iterator[list[Cue]]:
    """The cues in groups of at most MOST words. A group ends before the longest pause after its
    first LEAST words; of equal pauses before the last.
    """
    begin = 0
    while begin < len(spoken):
        count, end, best, pause = 0, begin, 0, -1.0
        while end < len(spoken) and count + spoken[end].words <= MOST:
            count += spoken[end].words
            end += 1
            if end < len(spoken) and count >= LEAST:
                gap = max(0.0, round(spoken[end].start_s - spoken[end - 1].end_s, 3))
                if gap >= pause:
                    best, pause = end, gap
        if end == len(spoken):
            best = end
        best = best or end
        yield list(spoken[begin:best])
        begin = best


def joined(window: Sequence[Cue]) -> tuple[str, list[tuple[int, float]]]:
    """A window's text, and where in it which second begins."""
    at, times = 0, []
    for cue in window:
        times.append((at, round(cue.start_s, 2)))
        at += len(cue.text) + 1
    return " ".join(cue.text for cue in window), times
