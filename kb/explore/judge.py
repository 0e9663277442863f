"""The page Judge: one item of a sample at a time, its clip, and a key for each answer.

`kb explore --judge NAME` serves it. Answers are taken only from the page itself: a request says
from which origin it comes, and has the token that the page was given.
"""

from __future__ import annotations

import secrets
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple
from urllib.parse import urlencode

from kb.artifacts import manifest
from kb.core.errors import UsageError
from kb.explore import pairs
from kb.explore.pairs import marked_pieces
from kb.explore.tables import CurrentTables
from kb.labels.judging import ItemSample, Judge
from kb.labels.questions import KINDS, PAIRS, Labeling, LabelQuestion
from kb.labels.sample import DescribedVideo, clip_times, described, has_text, surroundings

SAMPLE, _MOST = 400, 10_000  # items
# A row of keys for each question with options; the row behind them for all free answers.
_ROWS = ("12345", "qwert", "asdfg", "zcvb")
UNDO, SKIP, PLAY = "u", "x", "p"


class Choice(NamedTuple):
    """An option of a question: its name, what the page shows, its key, whether it is the answer."""

    name: str
    shown: str
    key: str
    chosen: bool


class AskedQuestion(NamedTuple):
    """A question as the page asks it; without choices the answer is free, and `key` leads to it."""

    question: LabelQuestion
    choices: list[Choice]
    key: str
    answer: str


@dataclass(frozen=True)
class JudgePage:
    """An item and its questions, None where all are judged or there is none. `text` is in pieces of
    which every second one is marked; `before` and `after` are what is said around it. `given` are
    the fields of the address and of each form; `token` goes with an answer.
    """

    labeling: Labeling
    sample: ItemSample
    given: dict[str, str]
    token: str = ""
    total: int = 0
    judged: int = 0
    row: dict[str, Any] = field(default_factory=dict)
    video: DescribedVideo = field(default_factory=DescribedVideo)
    text: list[str] = field(default_factory=list)
    before: str = ""
    after: str = ""
    asked: list[AskedQuestion] = field(default_factory=list)
    can_undo: bool = False
    is_on: bool = True
    kinds: tuple[str, ...] = tuple(f"{kind}s" for kind in KINDS)
    keys: tuple[str, str, str] = (PLAY, SKIP, UNDO)

    @property
    def times(self) -> tuple[int, int] | None:
        """Whole seconds of the clip; None: the whole video."""
        return clip_times(self.row, self.labeling)

    @property
    def clip(self) -> str:
        """The address of the clip's page."""
        start, end = self.times or (0, 0)
        place = {"video": self.row["video_id"], "start": start, "end": end}
        return f"/clip?{urlencode(place)}"

    @property
    def following(self) -> str:
        """The address of the next item that is not judged."""
        return self.address(after=self.row["item_id"])

    @property
    def free(self) -> list[AskedQuestion]:
        """The questions without options."""
        return [question for question in self.asked if not question.choices]

    def address(self, **changes: Any) -> str:
        """The page's address, with an item or the one after it."""
        return f"/judge?{urlencode(self.given | changes)}"


@dataclass(frozen=True)
class JudgeDesk:
    """The person who judges, and where their films are. `token` is another one at each start;
    `films` has the one that was found last, by video.
    """

    judge: Judge
    videos: tuple[Path, ...] = ()
    token: str = field(default_factory=lambda: secrets.token_urlsafe(32))
    films: dict[str, Path] = field(default_factory=dict)
    _known: dict[tuple[str, str], tuple[DescribedVideo, str, str]] = field(default_factory=dict)

    def surroundings_of(
        self, labeling: Labeling, row: dict[str, Any]
    ) -> tuple[DescribedVideo, str, str]:
        """The video of an item, and what is said before and after its text. Those of the last item
        are kept, as each of its answers asks for them.
        """
        key = labeling.kind, row["item_id"]
        if (known := self._known.get(key)) is None:
            root = self.judge.run.root
            files = manifest.rows(root, labeling.table)
            spoken = has_text(files) and labeling is PAIRS
            around = surroundings(root, files, [row]) if spoken else {}
            video = described(root, [row]).get(row["video_id"], DescribedVideo())
            known = video, *around.get(row["item_id"], ("", ""))
            self._known.clear()
            self._known[key] = known
        return known


def read(desk: JudgeDesk | None, query: Mapping[str, str]) -> JudgePage:
    """The item that an address names, else the first that the person has not judged, after that
    named `after` before any other. Raises UsageError, DamagedData.
    """
    sample, given = parse(desk, query)
    labeling = sample.labeling
    if desk is None:
        return JudgePage(labeling, sample, given, is_on=False)
    rows = desk.judge.rows(sample)
    if not rows:
        return JudgePage(labeling, sample, given, desk.token)
    answers, questions = desk.judge.answers(labeling), desk.judge.questions(labeling)
    needed = {question.name for question in questions if question.options}
    ids = [row["item_id"] for row in rows]
    open_items = {item for item in ids if not needed <= answers.get(item, {}).keys()}
    common: dict[str, Any] = {
        "token": desk.token,
        "total": len(ids),
        "judged": len(ids) - len(open_items),
        "can_undo": bool(desk.judge.changes),
    }
    wanted = query.get("item", "")
    if wanted not in ids:
        place = ids.index(query["after"]) + 1 if query.get("after") in ids else 0
        wanted = next((item for item in ids[place:] + ids[:place] if item in open_items), "")
    if not wanted:
        return JudgePage(labeling, sample, given, **common)
    row = rows[ids.index(wanted)]
    video, before, after = desk.surroundings_of(labeling, row)
    return JudgePage(
        labeling,
        sample,
        given,
        row=row,
        video=video,
        text=marked_pieces(row) if labeling is PAIRS else [],
        before=before,
        after=after,
        asked=_asked(questions, answers.get(wanted, {})),
        **common,
    )


def _asked(questions: list[LabelQuestion], answers: Mapping[str, str]) -> list[AskedQuestion]:
    rows = iter(_ROWS)
    asked = []
    for question in questions:
        keys = next(rows) if question.options else ""
        answer = answers.get(question.name, "")
        choices = [
            Choice(name, shown, key, name == answer)
            for (name, shown), key in zip(question.options, keys, strict=False)
        ]
        asked.append(AskedQuestion(question, choices, "", answer))
    free = iter(next(rows))
    return [one if one.choices else one._replace(key=next(free)) for one in asked]


def parse(desk: JudgeDesk | None, query: Mapping[str, str]) -> tuple[ItemSample, dict[str, str]]:
    """The sample of an address, and the fields that name it. Raises UsageError, DamagedData."""
    given = {
        name: query.get(name) or default
        for name, default in (("what", "pairs"), ("sample", str(SAMPLE)), ("seed", "0"))
    }
    kinds = {f"{kind}s": labeling for kind, labeling in KINDS.items()}
    if given["what"] not in kinds:
        raise UsageError(f"unknown kind {given['what']!r}", hint=f"use one of {', '.join(kinds)}")
    numbers = [_whole(given[name], most) for name, most in (("sample", _MOST), ("seed", 2**63))]
    labeling, where = kinds[given["what"]], ""
    if labeling is PAIRS and (filters := pairs.fields_of(query)) and desk is not None:
        tables = CurrentTables(desk.judge.run.root)
        where = pairs.where_of(query, pairs.columns_of(tables))
        given |= filters
    return ItemSample(labeling, max(1, numbers[0]), numbers[1], where), given


def _whole(text: str, most: int) -> int:
    if text.isascii() and text.isdigit() and int(text[:20]) <= most:
        return int(text)
    raise UsageError(f"{text!r} is not a number from 0 to {most:,}")


def answered(desk: JudgeDesk, query: Mapping[str, str]) -> str:
    """Write what a form of the page says; the address to go on at: the item's while it has
    questions left, else the next one's.

    Raises UsageError, FatalError, WriterLocked, DamagedData, DiskFull.
    """
    sample, given = parse(desk, query)
    item = query.get("item", "")
    if query.get("undo"):
        change = desk.judge.undo()
        if change is None:
            return f"/judge?{urlencode(given)}"
        given["what"] = f"{change.kind}s"
        return f"/judge?{urlencode(given | {'item': change.item_id})}"
    questions = desk.judge.questions(sample.labeling)
    names = {question.name for question in questions}
    desk.judge.give(sample, item, {name: text for name, text in query.items() if name in names})
    answers = desk.judge.answers(sample.labeling).get(item, {})
    # Who can answer freely as well says themselves when they are done.
    left = any(question.name not in answers or not question.options for question in questions)
    return f"/judge?{urlencode(given | {'item' if left else 'after': item})}"
