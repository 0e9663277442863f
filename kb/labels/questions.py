"""What people are asked of a pair and of a task. An answer's name is what tables and figures hold.

`yes` is the good answer of every question with options; `unsure` counts as no answer in shares.
"""

from dataclasses import dataclass

YES, UNSURE = "yes", "unsure"
NEAR_S = 5  # by how much a time may be off and still be right


@dataclass(frozen=True)
class Question:
    """A question and its options: name → what the page shows. `help` says how to decide.

    Without options the answer is free: seconds where `is_number`, else a text. Seconds are right
    when they are near the item's own, its column `compared`.
    """

    name: str
    text: str
    help: str
    options: tuple[tuple[str, str], ...] = ()
    compared: str = ""
    of_text: bool = False  # needs the spoken text, which releases lack

    @property
    def is_number(self) -> bool:
        """Whether the answer is a number of seconds."""
        return bool(self.compared)


@dataclass(frozen=True)
class Labeling:
    """A kind of items that people judge.

    `table`, made by `command`, holds them under `key`; `where` says which are asked about. The
    sample is stratified by `strata`. The player runs from `start` to `end`, and one judgement takes
    `seconds` besides watching.
    """

    kind: str
    table: str
    command: str
    key: str
    strata: tuple[str, ...]
    start: str
    end: str
    seconds: int
    questions: tuple[Question, ...]
    where: str = "true"

    @property
    def stratum(self) -> str:
        """SQL of a row's stratum."""
        return " || ' ' || ".join(f"coalesce({one}::VARCHAR, 'unknown')" for one in self.strata)


_UNSURE = (UNSURE, "Can't tell")

PAIRS = Labeling(
    kind="pair",
    table="pairs/pairs",
    command="kb pairs",
    key="pair_id",
    strata=("keyword_kind", "timing"),
    start="clip_start_s",
    end="clip_end_s",
    seconds=15,
    questions=(
        Question(
            "visible",
            "Is the keyword's object visible in the clip?",
            "Yes if it is on screen at any moment of the clip, also small, in a menu or in the"
            " inventory. No if people only speak of it.",
            ((YES, "Yes"), ("no", "No"), _UNSURE),
        ),
        Question(
            "described",
            "Does the text describe what is seen?",
            "Yes if somebody who only sees the clip would agree with the text. Partly if some of it"
            " fits. No for greetings, sponsors and talk of other things.",
            ((YES, "Yes"), ("partly", "Partly"), ("no", "No"), _UNSURE),
            of_text=True,
        ),
        Question(
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

KINDS = {one.kind: one for one in (PAIRS,)}
