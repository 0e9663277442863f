"""The histogram's bars and the slider's positions, against counting one by one."""

import duckdb
import pyarrow as pa
from hypothesis import given
from hypothesis import strategies as st

from kb.explore.histogram import draw, edges_of

WHOLE = st.integers(-50, 10_000_000).map(float)
SHARES = st.floats(0, 1, width=32)
OUTCOMES = st.sampled_from(["kept", "pending", "rejected"])


@given(
    st.lists(st.tuples(WHOLE | SHARES, st.booleans(), OUTCOMES), max_size=60),
    st.sampled_from([0.5, 5.0, 100.0]),
    st.booleans(),
)
def test_bars_hold_every_row_between_their_edges(
    rows: list[tuple[float, bool, str]], current: float, at_least: bool
) -> None:
    numbers, kept, outcomes = ([row[place] for row in rows] for place in range(3))
    with duckdb.connect() as con:
        con.register(
            "numbers",
            pa.table(
                {
                    "number": pa.array(numbers, pa.float64()),
                    "kept": pa.array(kept, pa.bool_()),
                    "outcome": pa.array(outcomes, pa.string()),
                }
            ),
        )
        edges = edges_of(con, current, at_least)
        histogram = draw(con, edges, current, current, at_least)
    assert edges == sorted(set(edges))
    assert edges[histogram.current] == edges[histogram.position] == current
    for bar in histogram.bars:
        inside = [
            (one, outcome)
            for number, one, outcome in rows
            if (bar.low <= number < bar.high if at_least else bar.low < number <= bar.high)
        ]
        assert bar.kept == sum(one for one, _ in inside)
        assert bar.others == sum(not one and outcome == "rejected" for one, outcome in inside)
        assert bar.kept + bar.deciding + bar.others == len(inside)
    counted = sum(bar.kept + bar.deciding + bar.others for bar in histogram.bars)
    assert counted == len(rows)
