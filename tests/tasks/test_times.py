"""When a task begins and ends: chapters, and mentions in a transcript."""

import pyarrow as pa
import pytest

from kb.pairs.transcript_batch import Text
from kb.tasks.build import TaskTimes, by_chapter, by_mentions, chapters

LISTED = """A tour.

0:00 Hello
1:05 - Building the iron farm
1:02:03 | Goodbye
"""


def test_chapters_are_lines_with_times_from_zero_on() -> None:
    found = chapters(LISTED, 4000.0)
    assert found == [(0, "Hello"), (65, "Building the iron farm"), (3723, "Goodbye")]
    assert chapters(LISTED, 100.0) == found[:2]


@pytest.mark.parametrize("text", ["", "1:05 the best part", "0:10 a\n0:20 b", "0:00 a\n0:00 b"])
def test_other_times_are_no_chapters(text: str) -> None:
    assert chapters(text, None) == []


def test_the_chapter_that_names_the_object_has_the_task() -> None:
    listed = chapters(LISTED, 4000.0)
    assert by_chapter(listed, ("simple", "iron", "farm"), 4000.0) == TaskTimes(65, 3723)
    assert by_chapter(listed, ("goodbye",), 4000.0) == TaskTimes(3723, 4000)
    assert by_chapter(listed, ("castle",), 4000.0) is None


def _said(*cues: tuple[float, str]) -> Text:
    cells = [{"start_s": at, "duration_s": 4.0, "text": text} for at, text in cues]
    return Text(pa.table({"video_id": ["v"], "kind": ["manual"], "cues": pa.array([cells])}))


def _times(words: tuple[str, ...], *cues: tuple[float, str]) -> TaskTimes | None:
    (found,) = by_mentions(_said(*cues), [words], 60)
    return found


def test_a_task_begins_with_mentions_that_have_company() -> None:
    """A castle is announced in the first second, and built from second 100 on."""
    cues = (
        (0, "castles today my friends"),
        (100, "a castle needs walls"),
        (150, "now this Castle is done"),
        (500, "look at the castle again"),
    )
    assert _times(("giant", "castle"), *cues) == TaskTimes(101.0, 154.0)


def test_the_longest_name_that_is_spoken_counts() -> None:
    cues = ((5, "a farm"), (20, "an iron farm"), (40, "the iron farm"))
    assert _times(("tiny", "iron", "farm"), *cues) == TaskTimes(21.333, 44.0)
    assert _times(("farmer",), *cues) is None


def test_one_mention_alone_is_its_cue() -> None:
    assert _times(("bow",), (7, "take a bow please"), (12, "and go")) == TaskTimes(9.0, 11.0)
