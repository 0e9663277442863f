"""How DuckDB is opened: in UTC, spilling to the data root, nothing loaded by itself."""

import re
from pathlib import Path

import pytest

from kb.store import atomic, leftovers
from kb.store.tables import database

KB = Path(__file__).resolve().parents[3] / "kb"
SORTED = "SELECT range::VARCHAR || repeat('x', 100) AS t FROM range(1000000) ORDER BY hash(range)"


def test_it_is_opened_in_one_place() -> None:
    opened = [
        path for path in KB.rglob("*.py") if re.search(r"duckdb\.connect\(", path.read_text())
    ]
    assert opened == [KB / "store" / "tables" / "database.py"]


def test_times_are_utc_in_every_zone(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TZ", "Asia/Tokyo")
    with database.connect() as con:
        assert con.execute("SELECT TIMESTAMPTZ '2026-01-01 00:00:00Z'::VARCHAR").fetchall() == [
            ("2026-01-01 00:00:00+00",)
        ]
        assert con.execute(
            "SELECT current_setting('autoinstall_known_extensions'),"
            " current_setting('autoload_known_extensions')"
        ).fetchall() == [(False, False)]


def test_it_spills_to_the_data_root_and_leaves_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    root, here = tmp_path / "root", tmp_path / "here"
    root.mkdir()
    here.mkdir()
    monkeypatch.chdir(here)
    con = database.connect(root, threads=1, memory="60MB")
    rows = con.sql(SORTED).to_arrow_reader(1000)
    rows.read_next_batch()
    [spill] = root.glob(f"{leftovers.SPILL}-*")
    assert list(spill.iterdir())
    assert not atomic.has_ended(spill.name)
    assert list(here.iterdir()) == []
    del rows
    con.close()
    assert list(root.iterdir()) == []
