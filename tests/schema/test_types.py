"""Tests of `kb.schema.tables`."""

import pyarrow as pa

from kb.schema.tables import parse_type


def test_types_nest() -> None:
    kind = parse_type("list<struct<a: int64, b: list<struct<c: string>>>>").arrow()
    assert kind == pa.list_(
        pa.struct([("a", pa.int64()), ("b", pa.list_(pa.struct([("c", pa.string())])))])
    )
