"""Tests of how answers are decoded to rows."""

from pathlib import Path

import pytest

from kb.core.errors import DamagedData
from kb.filters.filter_run import run_clean
from kb.store.rawlog import rawlog
from tests.wiki.handmade_data import MONDAY, page, put, told
from tests.wiki.parse.test_join import (
    root,  # noqa: F401  a fixture
    run_at,
    verdicts,
)


def test_unreadable_facts_of_the_wiki_are_rejected_with_what_was_found(root: Path) -> None:  # noqa: F811
    odd = [page(11, "Odd", "x1"), page(12, "Odder") | {"fullurl": None}, page(13, "Oddest")]
    odd[2]["revisions"][0]["timestamp"] = "soon"
    put(root, "pages", (MONDAY, told(*odd)))
    run_clean(run_at(root), "wiki")
    assert [verdicts(root)[key][:3] for key in ("11", "12", "13")] == [
        ("missing", "malformed", "x1"),
        ("missing", "absent", None),
        ("missing", "malformed", "soon"),
    ]


def test_unknown_keys_and_cut_off_files_are_counted(root: Path) -> None:  # noqa: F811
    put(root, "pages", (MONDAY, told(page(1, "Kept", mood="fine"))))
    put(
        root,
        "titles",
        (MONDAY, {"query": {"allpages": [{"pageid": 1, "ns": 0, "title": "Kept", "aura": 1}]}}),
        (MONDAY, told()),
    )
    last = rawlog.segments(root, "wiki", "titles")[-1]
    whole = last.read_bytes()
    last.write_bytes(whole[:-5])
    with pytest.raises(DamagedData, match=f"{last.name} is damaged") as caught:
        run_clean(run_at(root), "wiki")
    assert caught.value.summary["truncated_files"] == 1
    last.write_bytes(whole[: next(iter(rawlog.Frames(last)))[0]])
    summary = run_clean(run_at(root), "wiki")
    assert summary["unknown_keys"] == {
        "pages.query.pages[].mood": 1,
        "titles.query.allpages[].aura": 1,
    }
