"""Reads Label Studio's JSON exports of projects that `kb label export` wrote, as rows of labels."""

from collections import Counter
from collections.abc import Iterator, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Literal, NamedTuple

import msgspec
import pyarrow as pa

from kb.core.errors import UsageError
from kb.labels.questions import KINDS, LabelQuestion
from kb.schema.tables import table

LABELS = "labels/labels"


class LabeledItem(msgspec.Struct):
    """`data` of a task: what `kb label export` wrote of the item."""

    item_id: str
    kind: Literal["pair", "task"]
    video_id: str


class _Person(msgspec.Struct):
    id: int


class _Result(msgspec.Struct):
    value: dict[str, Any] = {}
    from_name: str = ""  # relations between regions have none


class _Annotation(msgspec.Struct):
    completed_by: int | _Person | None
    result: list[_Result]
    was_cancelled: bool = False
    created_at: datetime | None = None
    updated_at: datetime | None = None


class _Task(msgspec.Struct):
    data: LabeledItem
    annotations: list[_Annotation]


class ExportedAnswers(NamedTuple):
    """Rows of labels, and how many judgements and answers were not taken, by why.

    `skipped`: judgements that were skipped or have no answer; `undefined`: answers to other
    questions, with other options, or whose end is before their beginning.
    """

    rows: pa.Table
    skipped: int
    undefined: int


def read_exports(paths: Sequence[Path]) -> ExportedAnswers:
    """The answers of all files. Raises UsageError for the first that is no such export."""
    counts: Counter[str] = Counter()
    rows = [row for path in paths for task in _tasks(path) for row in _rows(task, counts)]
    made = pa.Table.from_pylist(rows, table(LABELS).arrow())
    return ExportedAnswers(made, counts["skipped"], counts["undefined"])


def _tasks(path: Path) -> list[_Task]:
    try:
        return msgspec.json.decode(path.read_bytes(), type=list[_Task])
    except OSError as error:
        raise UsageError(f"{path} can't be read: {error.strerror}") from None
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
        raise UsageError(
            f"{path} is not an export of such a project: {error}",
            hint="export the project from Label Studio as JSON (not JSON-MIN)",
        ) from None


def _rows(task: _Task, counts: Counter[str]) -> Iterator[dict[str, Any]]:
    asked = {one.name: one for one in KINDS[task.data.kind].questions}
    for annotation in task.annotations:
        found = [(asked.get(one.from_name), one.value) for one in annotation.result]
        answers = {one.name: answer(one, value) for one, value in found if one is not None}
        if annotation.was_cancelled or not found:
            counts["skipped"] += 1
            continue
        begins, ends = (answers.get(name) for name in ("begins_s", "ends_s"))
        if begins and ends and float(begins) > float(ends):
            answers["begins_s"] = answers["ends_s"] = None
        given = {name: text for name, text in answers.items() if text is not None}
        counts["undefined"] += len(found) - len(given)
        by, at = annotation.completed_by, annotation.updated_at or annotation.created_at
        at = at or datetime.fromtimestamp(0, UTC)
        common = {
            **msgspec.structs.asdict(task.data),
            "annotator": by.id if isinstance(by, _Person) else by or 0,
            "labelled_at": at if at.tzinfo else at.replace(tzinfo=UTC),
        }
        for name, text in given.items():
            yield {**common, "question": name, "answer": text}


def answer(question: LabelQuestion, value: dict[str, Any]) -> str | None:
    """An answer as labels have it; None for one that the question does not have."""
    if question.options:
        names = {one: name for name, shown in question.options for one in (name, shown)}
        match value.get("choices"):
            case [str(chosen)]:
                return names.get(chosen)
        return None
    if question.is_number:
        number = value.get("number")
        return f"{number:.10g}" if isinstance(number, (int, float)) and number >= 0 else None
    text = value.get("text")
    joined = "\n".join(map(str, text)) if isinstance(text, list) else str(text or "")
    return " ".join(joined.split()) or None
