"""What people said of the tasks of videos (labels/) → which stay, in which words, at which times.

A task is rejected when more judges answered no than yes to one of the two questions whether it is
one. Its wording is the latest of a judge who answered no to neither, and its times are the medians
of what these judges gave.
"""

from collections import Counter
from pathlib import Path
from statistics import median
from typing import NamedTuple

from kb.artifacts import manifest
from kb.store.tables import database, parquet
from kb.store.tables.reading import scan

_GATES = ("is_task", "possible")  # questions whose no rejects
_LABELS = "labels/labels"


class Verdict(NamedTuple):
    """What the judges of a video's task say together; `wording`: "" where nobody gave one."""

    judges: int
    rejected: bool
    wording: str
    begins_s: float | None
    ends_s: float | None

    def times(
        self, start: float | None, end: float | None, length_s: float | None
    ) -> tuple[float | None, float | None]:
        """The times in place of the mined ones. Where only one is given and the other does not fit
        it, the task reaches to that side's end of the video; times that contradict each other
        change nothing.
        """
        begins, ends = self.begins_s, self.ends_s
        if begins is None and ends is None:
            return start, end
        if begins is None:
            begins = start if start is not None and start < (ends or 0) else 0.0
        if ends is None:
            ends = end if end is not None and end > begins else length_s
        return (begins, ends) if ends is not None and begins < ends else (start, end)


def verdicts(root: Path) -> dict[str, Verdict]:
    """By video, as a title mined again may give another prompt. Raises DamagedData."""
    files = manifest.rows(root, _LABELS)
    if not files:
        return {}
    parquet.check(*files)
    with database.over(files, root) as con:
        rows = con.execute(
            f"""SELECT video_id, annotator, question::VARCHAR, answer
            FROM {scan(files)} WHERE kind = 'task' QUALIFY labelled_at
                = max(labelled_at) OVER (PARTITION BY video_id, annotator)
            ORDER BY labelled_at, annotator, item_id, question::VARCHAR"""
        ).fetchall()
    said: dict[str, dict[int, dict[str, str]]] = {}
    for video, annotator, question, answer in rows:
        said.setdefault(video, {}).setdefault(annotator, {})[question] = answer
    return {video: _together(list(judges.values())) for video, judges in said.items()}


def _together(judges: list[dict[str, str]]) -> Verdict:
    """`judges`: the answers of each one by question, the latest judge last."""
    counts = Counter((gate, one.get(gate)) for one in judges for gate in _GATES)
    rejected = any(counts[gate, "no"] > counts[gate, "yes"] for gate in _GATES)
    heard = [one for one in judges if all(one.get(gate) != "no" for gate in _GATES)]
    wordings = [one["wording"] for one in heard if one.get("wording")]
    begins, ends = (
        [float(one[question]) for one in heard if question in one]
        for question in ("begins_s", "ends_s")
    )
    return Verdict(
        len(judges),
        rejected,
        wordings[-1] if wordings else "",
        median(begins) if begins else None,
        median(ends) if ends else None,
    )
