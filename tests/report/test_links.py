"""Figures of entities."""

from pathlib import Path
from typing import Any

from kb.core.config.profile import load_profile
from kb.report import derived
from kb.report.data import ReportData
from tests.release.made import build
from tests.report.made import a_run


def test_what_is_spoken_of_and_who_knows_it(tmp_path: Path) -> None:
    def edit(name: str, made: list[dict[str, Any]]) -> None:
        if name == "links/entities":
            made.append({**made[0], "entity": "never named", "wiki_page_id": None})
        if name == "links/links":
            for row in made:
                row["count"] = 2

    build(tmp_path, edit, sources=("links",), export=False, n=12)
    profile = load_profile("minecraft")
    with ReportData(a_run(tmp_path)) as data:
        most, least, known = (
            make(data, profile) for make in (derived.most, derived.least, derived.known)
        )
    assert most is not None
    assert least is not None
    assert known is not None
    assert most.head == ("entity", "youtube", "wiki", "reddit", "mentions")
    assert most.rows == [
        ("oak log", 24, 24, 24, 72),
        ("diamond", 12, 12, 12, 36),
        ("iron pickaxe", 8, 8, 8, 24),
        ("wolf", 6, 6, 6, 18),
        ("wheat", 4, 0, 0, 4),
    ]
    assert least.rows == [*most.rows][::-1]
    assert least.caption.startswith("Named nowhere: 1 entities;")
    assert known.rows == [
        ("only videos", 1, "wheat"),
        ("only the wiki", 0, ""),
        ("only threads", 0, ""),
        ("two of the three", 0, ""),
        ("all three", 4, "oak log, diamond, iron pickaxe, wolf"),
    ]
    assert known.caption.endswith("one source alone names 1, none 1.")
