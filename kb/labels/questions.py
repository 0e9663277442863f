"""What people are asked of a pair and of a task. An answer's name is what tables and figures hold.

`yes` is the good answer of every question with options; `unsure` counts as no answer in shares.
"""

from dataclasses import dataclass, replace

YES, UNSURE = "yes", "unsure"
NEAR_S = 10  # by how much a time may be off and still be right


@dataclass(frozen=True)
class LabelQuestion:
    """A question and its options: name → what the page shows. `help` says how to decide.

    Without options the answer is free: seconds where `is_number`, else a text. Seconds are right
    when they are near the item's own, its column `compared`. `aligned`: it is asked of clips at the
    times of `kb pairs align` alone, and the others of spoken times.
    """

    name: str
    text: str
    help: str
    options: tuple[tuple[str, str], ...] = ()
    compared: str = ""
    of_text: bool = False  # needs the spoken text, which releases lack
    aligned: bool = False

    @property
    def is_number(self) -> bool:
        return bool(self.compared)


@dataclass(frozen=True)
class Labeling:
    """A kind of items that people judge.

    `table`, made by `command`, holds them under `key`, and its column `subject` says what they are
    about. The sample is stratified by `strata`. The player runs from `start` to `end`, and one
    judgement takes `seconds` besides watching. Where judgements change the table, `rejected` says
    where the items are that they took out (table, condition), and the columns `found` have the
    times from before.
    """

    kind: str
    table: str
    command: str
    key: str
    subject: str
    strata: tuple[str, ...]
    start: str
    end: str
    seconds: int
    questions: tuple[LabelQuestion, ...]
    rejected: tuple[tuple[str, str], ...] = ()
    found: tuple[str, str] | None = None

    @property
    def stratum(self) -> str:
        """SQL of a row's stratum."""
        return " || ' ' || ".join(f"coalesce({one}::VARCHAR, 'unknown')" for one in self.strata)


_UNSURE = (UNSURE, "Can't tell")
_VISIBLE = LabelQuestion(
    "visible",
    "Is the keyword's object visible in the clip?",
    "Yes if it is on screen at any moment of the clip, also small, in a menu or in the"
    " inventory. No if people only speak of it.",
    ((YES, "Yes"), ("no", "No"), _UNSURE),
)

PAIRS = Labeling(
    kind="pair",
    table="pairs/pairs",
    command="kb pairs",
    key="pair_id",
    subject="keyword",
    strata=("keyword_kind", "timing"),
    start="clip_start_s",
    end="clip_end_s",
    seconds=15,
    questions=(
        _VISIBLE,
        replace(_VISIBLE, name="visible_aligned", aligned=True),
        LabelQuestion(
            "described",
            "Does the text describe what is seen?",
            "Yes if somebody who only sees the clip would agree with the text. Partly if some of it"
            " fits. No for greetings, sponsors and talk of other things.",
            ((YES, "Yes"), ("partly", "Partly"), ("no", "No"), _UNSURE),
            of_text=True,
        ),
        LabelQuestion(
            "on_time",
            "Is the time right?",
            "Yes if the clip shows the moment that the text speaks of. Move the player a little to"
            " see what comes before and after.",
            (
                (YES, "Yes"),
                ("early", "The clip is too early"),
                ("late", "The clip is too late"),
                ("never", "That moment is not near"),
                _UNSURE,
            ),
        ),
    ),
)

TASKS = Labeling(
    kind="task",
    table="tasks/tasks",
    command="kb tasks",
    key="task_id",
    subject="prompt",
    strata=("start_source",),
    start="start_s",
    end="end_s",
    rejected=(("tasks/titles", "rejected_reason = 'judged'"),),
    found=("start_mined_s", "end_mined_s"),
    seconds=90,
    questions=(
        LabelQuestion(
            "is_task",
            "Is the prompt a task?",
            "Yes if somebody who reads only the prompt knows what to do, and could say afterwards"
            " whether it is done. No for greetings, titles of series and events.",
            ((YES, "Yes"), ("no", "No"), _UNSURE),
        ),
        LabelQuestion(
            "possible",
            "Is it possible in the domain of the video?",
            "Yes if it can be done there with the usual means. No if it needs changes that others"
            " do not have (mods, tricks of the video), or is no part of the domain.",
            ((YES, "Yes"), ("no", "No"), _UNSURE),
        ),
        LabelQuestion(
            "begins_s",
            "At which second of the video does the task begin?",
            "The second at which the doing begins, not the talk before it. Leave it empty where the"
            " video does not show the task.",
            compared="start_s",
        ),
        LabelQuestion(
            "ends_s",
            "At which second does it end?",
            "The second at which the task is done, or the video turns to something else.",
            compared="end_s",
        ),
        LabelQuestion(
            "wording",
            "A better wording?",
            "In the imperative and without names of people. Leave it empty if the prompt is fine.",
        ),
    ),
)

KINDS = {one.kind: one for one in (PAIRS, TASKS)}
