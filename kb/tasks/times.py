"""When a task begins and ends in its video: by chapters of the description, else by what is said.

Chapters are lines such as "1:05 Building the house", as YouTube reads them: the first one begins at
0:00, and each one later than the one before.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

from kb.core.installation import np
from kb.pairs.transcript_batch import Text

_CHAPTER = re.compile(r"^\W*((?:\d{1,2}:)?\d{1,2}:\d{2})\b\W*(\S.*)$", re.MULTILINE)
_FEWEST = 2  # chapters of a list; a single time is a remark


class TaskTimes(NamedTuple):
    """Seconds of the video."""

    start_s: float
    end_s: float


def chapters(description: str, length_s: float | None) -> list[tuple[float, str]]:
    """The start (s) and title of each chapter; [] where the lines are no list of chapters."""
    listed = [(_seconds(time), title) for time, title in _CHAPTER.findall(description)]
    rising = all(one < other for (one, _), (other, _) in pairwise(listed))
    if len(listed) < _FEWEST or listed[0][0] != 0 or not rising:
        return []
    return [one for one in listed if length_s is None or one[0] < length_s]


def _seconds(time: str) -> float:
    total = 0
    for part in time.split(":"):
        total = total * 60 + int(part)
    return float(total)


def by_chapter(
    listed: Sequence[tuple[float, str]], words: Sequence[str], length_s: float | None
) -> TaskTimes | None:
    """The times of the first chapter whose title names the object."""
    for named in _suffixes(words):
        for number, (start, title) in enumerate(listed):
            if named.search(title.encode()):
                following = listed[number + 1 :]
                end = following[0][0] if following else length_s
                return TaskTimes(start, end) if end is not None else None
    return None


def by_mentions(
    text: Text, objects: Sequence[Sequence[str]], max_gap_s: float
) -> list[TaskTimes | None]:
    """The times in which each transcript of a batch speaks of its object; None where it does not.

    Mentions at most `max_gap_s` apart belong together. The task begins with the first of those that
    have company, as a single mention is a greeting or an announcement, and ends with the cue of the
    last. Where all stand alone, it is the first one's cue from the mention on.
    """
    return [
        _mentioned(text, number, words, max_gap_s * 1000) for number, words in enumerate(objects)
    ]


def _mentioned(text: Text, number: int, words: Sequence[str], max_gap: float) -> TaskTimes | None:
    begin, end = int(text.video_at[number]), int(text.video_end[number])
    for named in _suffixes(words):
        places = np.array([one.start() for one in named.finditer(text.raw, begin, end)], np.int64)
        if len(places):
            break
    else:
        return None
    starts = text.time_of(places)
    parted = np.flatnonzero(np.diff(starts) > max_gap) + 1
    groups = np.split(np.arange(len(places)), parted)
    group = next((one for one in groups if len(one) > 1), groups[0])
    last = int(text.cue_end[text.cue_of(places[group[-1:]])][0])
    start = int(starts[group[0]])
    return TaskTimes(start / 1000, max(last, start) / 1000)


def _suffixes(words: Sequence[str]) -> list[re.Pattern[bytes]]:
    """Patterns of the object's words, whole, then without the first ones: of "simple wooden house"
    a transcript may have "wooden house" or "house".
    """
    every = [rb"\W+".join(re.escape(one.encode()) for one in words[n:]) for n in range(len(words))]
    return [re.compile(rb"(?<!\w)" + one + rb"(?:e?s)?(?!\w)", re.IGNORECASE) for one in every]
