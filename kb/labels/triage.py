"""Titles one after another, in the terminal: a person accepts, rejects or rewords each prompt.

An answer is one key and is written at once, so that the next run goes on with the next title. It is
a row of labels/, as the answers of Label Studio are.
"""

import os
import select
import termios
import tty
from collections import Counter
from collections.abc import Callable
from typing import Any, TextIO

from kb.artifacts import domain_binding, manifest
from kb.core import clock, signals
from kb.core.context import Run
from kb.core.errors import FatalError
from kb.core.summary import Summary
from kb.labels.export import DescribedVideo, described
from kb.labels.imports import import_exports, replace_answers, stored
from kb.labels.questions import TASKS, YES
from kb.store.layout import Layout
from kb.store.tables import parquet

KEYS = "a accept · r reject · e edit · b back · q quit"
_COUNTED = {"a": "accepted", "r": "rejected", "e": "reworded"}
_WAIT_S = 0.2  # for a key, until a signal is heard


def triage(run: Run, annotator: int, say: Callable[[str], None], keyboard: TextIO) -> Summary:
    """Show each task that this person has not judged yet, and write what they answer.

    `say` shows a line. Raises FatalError without tasks, WriterLocked, DamagedData, DiskFull,
    Interrupted.
    """
    waiting = _waiting(run, annotator)
    videos = described(run.root, waiting)
    answered: dict[int, str] = {}
    place = 0
    while place < len(waiting):
        row = waiting[place]
        video = videos.get(row["video_id"], DescribedVideo())
        minutes, seconds = divmod(round(video.length_s or 0), 60)
        say(f"{place + 1} of {len(waiting)}: {video.title}")
        say(f"  channel  {video.channel}, {minutes}:{seconds:02}")
        say(f"  prompt   {row['prompt']}")
        say(f"  {KEYS}")
        key, wording = _key(keyboard), ""
        if key in ("", "\x04", "q"):  # the end of a pipe, Ctrl-D
            break
        if key == "b":
            place = max(place - 1, 0)
            continue
        if key == "e":
            say("  a better wording (empty: none):")
            wording = _line(keyboard)
        if key not in _COUNTED or (key == "e" and not wording):
            continue
        given = {"is_task": "no" if key == "r" else YES}
        _write(run, row, annotator, given | ({"wording": wording} if wording else {}))
        answered[place] = _COUNTED[key]
        place += 1
    if answered:
        import_exports(run, ())  # counts all answers
    counts = Counter(answered.values())
    return Summary(
        command="label triage",
        **{f"{name}_tasks": counts[name] for name in _COUNTED.values()},
        left=len(waiting) - len(answered),
        path=str(Layout(run.root).labels),
    )


def _waiting(run: Run, annotator: int) -> list[dict[str, Any]]:
    """Tasks that this person has not judged."""
    files = manifest.rows(run.root, TASKS.table)
    if not files:
        raise FatalError("there are no tasks to judge", hint=f"run `{TASKS.command}` first")
    judged = {
        row["video_id"]
        for row in stored(run.root).to_pylist()
        if (row["kind"], row["annotator"]) == (TASKS.kind, annotator)
    }
    columns = ["task_id", "video_id", "prompt"]
    rows = [row for path in files for row in parquet.read_table(path, columns).to_pylist()]
    return [row for row in rows if row["video_id"] not in judged]


def _write(run: Run, row: dict[str, Any], annotator: int, given: dict[str, str]) -> None:
    about = {"item_id": row["task_id"], "kind": TASKS.kind, "video_id": row["video_id"]}
    about |= {"annotator": annotator, "labelled_at": clock.now()}
    with domain_binding.writing(run, "labels"):
        answers = [about | {"question": name, "answer": text} for name, text in given.items()]
        replace_answers(run.root, answers)


def _key(stream: TextIO) -> str:
    """The next key, without Enter on a terminal; the next letter of a pipe; "" at the end."""
    number = stream.fileno()
    before = termios.tcgetattr(number) if os.isatty(number) else None
    try:
        if before is not None:
            tty.setcbreak(number)
        while (one := _byte(number)).isspace():
            pass
        return one.decode("latin-1").lower()
    finally:
        if before is not None:
            termios.tcsetattr(number, termios.TCSADRAIN, before)


def _line(stream: TextIO) -> str:
    """What is typed up to Enter. In a pipe it may begin on the line after its key."""
    number, typed = stream.fileno(), bytearray()
    while one := _byte(number):
        if one == b"\n" and (typed.strip() or os.isatty(number)):
            break
        typed += one
    return " ".join(typed.decode("utf-8", "replace").split())


def _byte(number: int) -> bytes:
    while not select.select([number], [], [], _WAIT_S)[0]:
        signals.stop.raise_if_asked()
    return os.read(number, 1)
