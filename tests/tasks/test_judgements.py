"""What several judges say together, by the rule in words: counted here by hand."""

from collections.abc import Mapping
from datetime import UTC, datetime, timedelta
from pathlib import Path
from statistics import median

import pyarrow as pa
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from kb.artifacts import manifest
from kb.schema.tables import table
from kb.store.tables.shard_writer import write_table
from kb.tasks.build import Verdict, verdicts

GATE = st.sampled_from(["yes", "no", "unsure", None])
JUDGE = st.fixed_dictionaries(
    {
        "is_task": GATE,
        "possible": GATE,
        "wording": st.sampled_from([None, "build a", "build b"]),
        "begins_s": st.sampled_from([None, "3", "8", "20.5"]),
    }
)
START = datetime(2026, 11, 1, tzinfo=UTC)


def _verdict(root: Path, judges: list[Mapping[str, str | None]]) -> Verdict | None:
    rows = [
        {
            "item_id": "i",
            "kind": "task",
            "video_id": "v",
            "annotator": number,
            "question": question,
            "answer": answer,
            "labelled_at": START + timedelta(minutes=(number * 7) % 11),
        }
        for number, judge in enumerate(judges)
        for question, answer in judge.items()
        if answer is not None
    ]
    with manifest.replacing(root, "labels", inputs={}) as fresh:
        made = pa.Table.from_pylist(rows, table("labels/labels").arrow())
        write_table(fresh.folder / "labels-00000-of-00001.parquet", made, "labels/labels")
    return verdicts(root).get("v")


@settings(max_examples=25, deadline=None)
@given(st.lists(JUDGE, min_size=1, max_size=5))
def test_more_no_than_yes_rejects_and_the_latest_of_the_others_is_heard(
    tmp_path_factory: pytest.TempPathFactory, judges: list[Mapping[str, str | None]]
) -> None:
    found = _verdict(tmp_path_factory.mktemp("verdict"), judges)
    said = [(number, one) for number, one in enumerate(judges) if any(one.values())]
    if not said:
        assert found is None
        return
    assert found is not None
    assert found.judges == len(said)
    no_wins = [
        sum(one[gate] == "no" for one in judges) > sum(one[gate] == "yes" for one in judges)
        for gate in ("is_task", "possible")
    ]
    assert found.rejected == any(no_wins)
    heard = [(n, one) for n, one in said if "no" not in (one["is_task"], one["possible"])]
    heard.sort(key=lambda item: (item[0] * 7) % 11)
    wordings = [one["wording"] for _, one in heard if one["wording"]]
    assert found.wording == (wordings[-1] if wordings else "")
    begins = [float(one["begins_s"]) for _, one in heard if one["begins_s"]]
    assert found.begins_s == (median(begins) if begins else None)


@pytest.mark.parametrize(
    ("begins", "ends", "mined", "length", "times"),
    [
        (None, None, (5.0, 9.0), 60.0, (5.0, 9.0)),
        (6.0, 8.0, (5.0, 9.0), 60.0, (6.0, 8.0)),
        (6.0, None, (5.0, 9.0), 60.0, (6.0, 9.0)),
        (10.0, None, (5.0, 9.0), 60.0, (10.0, 60.0)),
        (None, 4.0, (5.0, 9.0), 60.0, (0.0, 4.0)),
        (3.0, None, (None, None), 60.0, (3.0, 60.0)),
        (3.0, None, (None, None), None, (None, None)),
        (8.0, 7.0, (5.0, 9.0), 60.0, (5.0, 9.0)),
    ],
)
def test_times_that_people_gave_replace_the_mined_ones(
    begins: float | None,
    ends: float | None,
    mined: tuple[float | None, float | None],
    length: float | None,
    times: tuple[float | None, float | None],
) -> None:
    verdict = Verdict(1, False, "", begins, ends)
    assert verdict.times(*mined, length) == times
