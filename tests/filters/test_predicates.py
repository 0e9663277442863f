"""Predicates: one literal row a reason."""

from typing import Any

import pyarrow as pa

from kb.filters.predicates import (
    AtLeast,
    AtMost,
    In,
    NotIn,
    NotTrue,
    Predicate,
    Present,
    RatioAtLeast,
    RecordedReason,
    Waits,
    rows_passing,
)

PROBLEMS = pa.list_(
    pa.struct([("column", pa.string()), ("reason", pa.string()), ("value", pa.string())])
)


def judge(
    predicate: Predicate, problems: list[list[dict[str, Any]]] | None = None, **columns: Any
) -> list[tuple[Any, Any]]:
    size = len(next(iter(columns.values())))
    rows = pa.table(
        {
            **{
                name: values if isinstance(values, pa.Array) else pa.array(values)
                for name, values in columns.items()
            },
            "problems": pa.array(problems or [[]] * size, PROBLEMS),
        }
    )
    judged = predicate.judge(rows)
    assert len(judged.reason) == len(judged.value) == size
    return list(zip(judged.reason.to_pylist(), judged.value.to_pylist(), strict=True))


def bad(column: str, value: str) -> list[dict[str, Any]]:
    return [{"column": column, "reason": "malformed", "value": value}]


def test_at_least() -> None:
    stage = AtLeast("view_count", 100, stage="views")
    rows = judge(
        stage,
        [
            [],
            [],
            [],
            [{"column": "view_count", "reason": "absent", "value": None}],
            bad("view_count", "-5"),
            bad("other", "x"),
        ],
        view_count=[100, 99, 10**12, None, None, None],
    )
    assert rows == [
        (None, None),
        ("below", "99"),
        (None, None),
        ("absent", None),
        ("malformed", "-5"),
        ("absent", None),
    ]
    assert (stage.judge(pa.table({"view_count": [5]})).threshold, stage.reads) == (
        "100",
        {"view_count"},
    )


def test_ratio() -> None:
    stage = RatioAtLeast("width", "height", 1.0, stage="aspect_ratio")
    rows = judge(
        stage,
        [[]] * 5 + [bad("height", "tall")],
        width=[854, 405, 480, 854, None, 5],
        height=[480, 720, 480, 0, 4, None],
    )
    assert rows == [
        (None, None),
        ("below", "0.5625"),
        (None, None),
        ("malformed", "854 x 0"),
        ("absent", None),
        ("malformed", "tall"),
    ]


def test_at_most_with_scores() -> None:
    scores = pa.array([0.5, 0.50001, None, 0.1], pa.float32())
    assert judge(
        AtMost("s", 0.5, stage="toxicity", null_passes=True, reason="title"), s=scores
    ) == [(None, None), ("title", "0.50001"), (None, None), (None, None)]
    assert judge(AtMost("s", 0.5, stage="x"), s=scores)[2] == ("absent", None)


def test_flags_and_sets() -> None:
    assert judge(NotTrue("nsfw", stage="nsfw", reason="nsfw"), nsfw=[True, False, None]) == [
        ("nsfw", None),
        (None, None),
        (None, None),
    ]
    assert judge(
        NotIn("kind", ("none", "disabled"), stage="transcript"), kind=["none", "asr", None]
    ) == [("none", "none"), (None, None), (None, None)]
    assert judge(In("kind", ("a",), stage="x"), kind=["a", "b", None]) == [
        (None, None),
        ("other", "b"),
        ("absent", None),
    ]
    assert judge(
        Present("kind", stage="x"), [[], bad("kind", "7"), []], kind=["a", None, None]
    ) == [(None, None), ("malformed", "7"), ("absent", None)]
    waits = Waits("kind", ("unknown",), stage="transcript", reason="transcript")
    assert judge(waits, kind=["unknown", "asr"]) == [("transcript", None), (None, None)]
    assert waits.judge(pa.table({"kind": ["unknown"]})).verdict == "pending"
    told = RecordedReason("render", stage="render", value="said")
    assert judge(told, render=["too_tall", None, "http_500"], said=["12", "x", None]) == [
        ("too_tall", "12"),
        (None, None),
        ("http_500", None),
    ]


def test_no_rows() -> None:
    for stage in (
        AtLeast("a", 1, stage="x"),
        AtMost("a", 1, stage="x"),
        RatioAtLeast("a", "a", 1, stage="x"),
        In("a", (1,), stage="x"),
    ):
        assert judge(stage, a=pa.array([], pa.int64())) == []


def test_rows_passing_pass_all_of_them() -> None:
    rows = pa.table({"a": [1, 5, 5], "b": [5, 5, None]})
    assert rows_passing(
        (AtLeast("a", 2, stage="x"), AtLeast("b", 2, stage="y")), rows
    ).to_pylist() == [
        False,
        True,
        False,
    ]
    assert rows_passing((), rows).to_pylist() == [True] * 3
