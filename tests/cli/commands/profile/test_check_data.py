"""`kb profile check --data`."""

import json
from pathlib import Path
from typing import Any

from tests.cli.commands.profile.conftest import row, written
from tests.cli.conftest import Kb
from tests.pairs.made import fill, tables


def test_over_a_data_root_it_shows_what_each_keyword_hits(
    tmp_path: Path, kb: Kb, make_rows: Any
) -> None:
    root = tmp_path / "found"
    fill(root, *tables(40, 300, ["saxifrage", "spring", "alpine trough"], share=0.05), make_rows)
    path = written(tmp_path, row("Edelweiss\tplant\n", ""))
    before = sorted(root.rglob("*"))
    shown = kb("profile", "check", str(path), "--data", str(root), "--quiet")
    assert shown.returncode == 0, shown.stderr
    assert "[saxifrage]" in shown.stdout
    assert "1 of 4 match nothing" in shown.stdout
    assert "Edelweiss" in shown.stdout
    told = kb("profile", "check", str(path), "--data", str(root), "--json", "--quiet")
    hits = {one["keyword"]: one for one in json.loads(told.stdout)["hits"]}
    assert set(hits) == {"Saxifrage", "Spring", "Alpine Trough", "Edelweiss"}
    assert hits["Saxifrage"]["matches"] > 10
    assert hits["Spring"]["rule"] == "near:10"
    assert 1 <= len(hits["Saxifrage"]["examples"]) <= 3
    assert hits["Edelweiss"]["matches"] == 0
    assert sorted(root.rglob("*")) == before
    judged = kb("pairs", "keywords", "--profile", str(path), "--data", str(root), "--quiet")
    assert f"Saxifrage\tplant\t\t{hits['Saxifrage']['matches']}\t" in judged.stdout
    none = kb("profile", "check", str(path), "--data", "nowhere")
    assert none.returncode == 2
    assert "there is no data root" in none.stderr
