"""Tests of `kb.schema.tables`."""

import pyarrow as pa
import pytest

from kb.core.errors import SchemaMismatch
from kb.schema import conform, table


def test_conform_casts_orders_and_refuses(make_rows) -> None:
    rows = make_rows("wiki/cells", 2)
    narrow = rows.set_column(
        rows.column_names.index("row_index"), "row_index", pa.array([0, 1], pa.int32())
    )
    shuffled = narrow.select(list(reversed(narrow.column_names)))
    done = conform("wiki/cells", shuffled)
    assert done.schema.equals(table("wiki/cells").arrow(), check_metadata=True)
    with pytest.raises(SchemaMismatch, match="column 'text' has 1 nulls and may have none"):
        conform("wiki/cells", make_rows("wiki/cells", 2, text=["a", None]))
    with pytest.raises(SchemaMismatch, match="column 'row_index' is double, not int64"):
        conform(
            "wiki/cells",
            rows.set_column(rows.column_names.index("row_index"), "row_index", pa.array([0.5, 1])),
        )
    nullable = make_rows("youtube/videos", 2, like_count=[None, 1], fps=[None, 30])
    assert conform("youtube/videos", nullable)["like_count"].null_count == 1
    # released tables need their own columns only
    assert (
        conform(
            "youtube/videos",
            nullable.select(table("youtube/videos").names(released=True)),
            released=True,
        ).num_rows
        == 2
    )
