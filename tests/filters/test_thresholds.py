"""What a filter keeps of rows that a threshold rejects."""

from typing import Any

import pyarrow as pa

from kb.filters.chain import Chain, judge_chain
from kb.filters.predicates import AtLeast, NotTrue, Predicate, Waits, none_above
from kb.filters.thresholds import thresholds
from kb.youtube.topic import Topic

SCORES = {"title": "toxicity_title", "description": "toxicity_description"}


def rejected(stages: tuple[Predicate, ...], **columns: list[Any]) -> list[tuple[Any, ...]]:
    """(stage, number, other stages) of each rejected row, in order."""
    size = len(next(iter(columns.values())))
    key = [f"k{number}" for number in range(size)]
    rows = pa.table({"key": key, **columns})
    chain = Chain("shared/rejected", "key", stages, scores=SCORES if "title" in columns else {})
    out = judge_chain(rows, chain, lambda given: given).rejected.sort_by("key")
    names = ("stage", "number", "other_stages")
    return list(zip(*(out[name].to_pylist() for name in names), strict=True))


def test_other_stages_decide_before_and_after_the_threshold() -> None:
    stages = (
        AtLeast("views", 100, "views"),
        NotTrue("adult", stage="adult", reason="adult"),
        Waits("kind", ("unknown",), stage="transcript", reason="transcript"),
    )
    assert rejected(
        stages,
        views=[99, 5, 7, None, 100],
        adult=[False, True, False, False, True],
        kind=["manual", "manual", "unknown", "manual", "manual"],
    ) == [
        ("views", 99.0, "kept"),
        ("views", 5.0, "rejected"),
        ("views", 7.0, "pending"),
        ("views", None, None),
        ("adult", None, None),
    ]


def test_a_row_whose_texts_have_no_score_yet_may_be_kept() -> None:
    stages = (AtLeast("views", 100, "views"), *none_above(0.5, SCORES))
    nothing = pa.table(
        {
            "key": ["a", "b", "c"],
            "views": [1, 2, 3],
            "title": ["words", "", None],
            "description": [None, "", "words"],
        }
    )
    chain = Chain("shared/rejected", "key", stages, scores=SCORES)
    out = judge_chain(nothing, chain, add_scores).rejected.sort_by("key")
    assert out["other_stages"].to_pylist() == ["unscored", "kept", "unscored"]


def add_scores(rows: pa.Table) -> pa.Table:
    for column in SCORES.values():
        rows = rows.append_column(column, pa.nulls(rows.num_rows, pa.float32()))
    return rows


def test_of_two_scores_the_larger_one_decides() -> None:
    scores = {name: pa.array(values, pa.float32()) for name, values in BOTH.items()}
    stages = none_above(0.5, SCORES, "toxicity.thresholds.youtube")
    (threshold,) = thresholds(stages)
    assert (threshold.limit, threshold.at_least) == (0.5, False)
    assert threshold.setting == "toxicity.thresholds.youtube"
    assert threshold.numbers(pa.table(scores)).to_pylist() == [0.9, 0.3, 0.7, None]


BOTH = {
    "toxicity_title": [0.6, 0.3, None, None],
    "toxicity_description": [0.9, 0.1, 0.7, None],
}


def test_a_topic_waits_for_its_label_only_within_its_gate() -> None:
    """A video without a label that a lower `views` lets through waits for its label."""
    gate = (AtLeast("view_count", 100, "views"),)
    stages = (Topic(("UC1",), (20,), ("Minecraft",), gate), *gate)
    assert rejected(
        stages,
        view_count=[50, 50],
        category_id=[20, 20],
        title=["Minecraft", "Minecraft"],
        description=["", ""],
        tags=pa.array([[], []], pa.list_(pa.string())),
        game_label_id=pa.array([None, "UC1"], pa.string()),
        game_label=pa.array([None, "Minecraft"], pa.string()),
        transcript_outcome=pa.array([None, None], pa.string()),
    ) == [("views", 50.0, "pending"), ("views", 50.0, "kept")]
