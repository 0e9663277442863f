"""Tests of `kb.schema.declaration`."""

from kb.schema.declaration import check_table


def test_wrong_keys_of_a_table_come_all_at_once() -> None:
    column = {"name": "a", "type": "string", "doc": "Doc.", "from": "rule: x"}
    problems = check_table(
        {
            "name": "x/t",
            "colum": 1,
            "key": ["b"],
            "sort_by": [],
            "column": [column, column],
        }
    )
    assert problems == [
        "unknown key 'colum'",
        "`doc` is missing or empty",
        "column a: declared twice",
        "`key` names 'b', which is no column",
        "`sort_by` must list columns",
    ]
