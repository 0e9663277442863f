"""One person judges a sample item by item, in the browser (kb.explore.judge).

Each answer is written at once, into the same rows of labels/ as those of Label Studio. All answers
of a person to an item have one time, the last one's, as an import keeps a person's newest time of
an item.
"""

import hashlib
import threading
import unicodedata
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, NamedTuple

from kb.artifacts import domain_binding, manifest, table_catalog
from kb.artifacts.table_catalog import Catalog
from kb.core import clock
from kb.core.context import Run
from kb.core.errors import FatalError, SettingError, UsageError
from kb.labels.imports import answer, import_exports, replace_answers, stored
from kb.labels.questions import Labeling, LabelQuestion
from kb.labels.sample import asked_questions, drawn_rows, has_text
from kb.pairs.pair_selection import asking

_FIRST_NAMED = 1 << 52  # above every number of Label Studio
_ROUNDS = 200_000  # so that guessing names takes long


def annotator_number(name: str) -> int:
    """The number of a person in labels/: the same for a name on every machine, in any letter case,
    and none that an account of Label Studio has. Raises SettingError for a name without letters.
    """
    folded = " ".join(unicodedata.normalize("NFKC", name).casefold().split())
    if not folded:
        raise SettingError("--judge names nobody", hint="give the name of the person who judges")
    encoded = folded.encode("utf-8", "surrogateescape")
    digest = hashlib.pbkdf2_hmac("sha256", encoded, b"lorecrawl annotator", _ROUNDS, 8)
    return _FIRST_NAMED | int.from_bytes(digest, "big") >> 12


class ItemSample(NamedTuple):
    """Which items are judged: at most `size` of those that meet the condition `where`."""

    labeling: Labeling
    size: int
    seed: int
    where: str = ""


class AnswersBefore(NamedTuple):
    """The rows of an item before its answers were changed."""

    kind: str
    item_id: str
    rows: list[dict[str, Any]]


@dataclass
class Judge:
    """A person, by number, who judges items of a data root."""

    run: Run
    annotator: int
    changes: list[AnswersBefore] = field(default_factory=list)  # since the start, for `undo`
    _sample: tuple[Any, list[dict[str, Any]]] = (None, [])
    _writing: threading.Lock = field(default_factory=threading.Lock)

    def __post_init__(self) -> None:
        if not Catalog(self.run.root.absolute()).is_writable:
            raise UsageError(
                f"{self.run.root} can't keep answers", hint="--judge needs a data root of your own"
            )

    def rows(self, sample: ItemSample) -> list[dict[str, Any]]:
        """The items in the order of the sample, which stays while their table does; [] without any.

        Raises UsageError for a condition that can't be asked, DamagedData.
        """
        root = self.run.root
        files = manifest.rows(root, sample.labeling.table)
        if not files:
            return []
        key = sample, [(path, path.stat().st_mtime_ns) for path in files]
        known, rows = self._sample
        if known != key:
            where = "text IS NOT NULL" if has_text(files) else "true"
            if sample.where:
                asked = asking(table_catalog.read_catalog(root), where=sample.where)
                where += f" AND pair_id IN (SELECT pair_id FROM ({asked}))"
            rows = drawn_rows(root, files, sample.labeling, sample.size, sample.seed, where)
            self._sample = key, rows
        return rows

    def questions(self, labeling: Labeling) -> list[LabelQuestion]:
        """Those that can be asked about the items that are there."""
        return asked_questions(labeling, manifest.rows(self.run.root, labeling.table))

    def answers(self, labeling: Labeling) -> dict[str, dict[str, str]]:
        """What this person has answered, by item and question."""
        given: dict[str, dict[str, str]] = {}
        for row in stored(self.run.root).to_pylist():
            if (row["kind"], row["annotator"]) == (labeling.kind, self.annotator):
                given.setdefault(row["item_id"], {})[row["question"]] = row["answer"]
        return given

    def give(self, sample: ItemSample, item_id: str, given: Mapping[str, str]) -> None:
        """Write answers by question, beside those that the person gave before; an empty one takes
        the answer away.

        Raises UsageError for an answer that the question does not have, FatalError for an item that
        is no longer there, WriterLocked, DamagedData, DiskFull.
        """
        labeling = sample.labeling
        taken = {
            question.name: _understood(question, given[question.name])
            for question in self.questions(labeling)
            if question.name in given
        }
        with self._writing, domain_binding.writing(self.run, "labels"):
            item = next((row for row in self.rows(sample) if row["item_id"] == item_id), None)
            if item is None:
                raise FatalError("this item is no longer there", hint="load the page again")
            answers = self.answers(labeling).get(item_id, {}) | taken
            begins, ends = (answers.get(name) for name in ("begins_s", "ends_s"))
            if begins and ends and float(begins) > float(ends):
                raise UsageError("the end is before the beginning", hint="correct one of the times")
            about = {"item_id": item_id, "kind": labeling.kind, "video_id": item["video_id"]}
            about |= {"annotator": self.annotator, "labelled_at": clock.now()}
            rows = [about | {"question": q, "answer": text} for q, text in answers.items() if text]
            self._replace(labeling.kind, item_id, rows)

    def undo(self) -> AnswersBefore | None:
        """Take back the last change since the start, and return it; None where there is none.

        Raises WriterLocked, DamagedData, DiskFull.
        """
        with self._writing, domain_binding.writing(self.run, "labels"):
            if not self.changes:
                return None
            change = self.changes[-1]
            replace_answers(self.run.root, change.kind, change.item_id, self.annotator, change.rows)
            return self.changes.pop()

    def _replace(self, kind: str, item_id: str, rows: list[dict[str, Any]]) -> None:
        before = replace_answers(self.run.root, kind, item_id, self.annotator, rows)
        self.changes.append(AnswersBefore(kind, item_id, before))

    def measure(self) -> None:
        """Write what all answers say of all pairs. Raises what an import does."""
        if stored(self.run.root).num_rows:
            import_exports(self.run, ())


def _understood(question: LabelQuestion, text: str) -> str:
    """An answer as labels have it; "" for none. Raises UsageError for one that is none."""
    if not text.strip():
        return ""
    value: dict[str, Any] = {"choices": [text], "text": text}
    if question.is_number:
        try:
            value["number"] = float(text)
        except ValueError:
            value["number"] = None
    if (known := answer(question, value)) is None:
        raise UsageError(f"{text!r} is no answer to {question.text!r}")
    return known
