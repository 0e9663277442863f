"""What people are asked of tasks, from a project to figures."""

import json
import shutil
from pathlib import Path
from typing import Any

import pytest

from kb.artifacts import manifest
from kb.artifacts.measures import read_measures
from kb.core.context import Run
from kb.labels.questions import KINDS, UNSURE, YES
from kb.query import connect, select
from kb.release.metadata.quality import judgements
from kb.store.tables.shard_writer import write_table
from tests.inprocess import Here
from tests.labels.answers import exported, items, judgement

SOURCES = ["chapter"] * 12 + ["transcript"] * 20 + ["none"] * 4


@pytest.fixture
def root(judged: Run, tmp_path: Path, make_rows: Any) -> Path:
    """A data root with 36 tasks, 4 of them without times."""
    shutil.copytree(judged.root, tmp_path / "data")
    times = [(None if one == "none" else 30.0 + n) for n, one in enumerate(SOURCES)]
    rows = make_rows(
        "tasks/tasks",
        len(SOURCES),
        task_id=[f"{n:016x}" for n in range(len(SOURCES))],
        prompt=[f"build <{n}> farms" for n in range(len(SOURCES))],
        video_id=[f"v{n:010d}" for n in range(len(SOURCES))],
        start_source=SOURCES,
        collection=["youtube"] * len(SOURCES),
        start_s=times,
        end_s=[None if one is None else one + 50.5 for one in times],
    )
    with manifest.replacing(tmp_path / "data", "tasks", inputs={}) as fresh:
        write_table(fresh.folder / "tasks-00000-of-00001.parquet", rows, "tasks/tasks")
    return tmp_path / "data"


def test_options_have_one_good_answer() -> None:
    for kind in KINDS.values():
        for question in kind.questions:
            if question.options:
                assert {YES, UNSURE} < {name for name, _ in question.options}


def test_tasks_go_there_and_back(root: Path, here: Here, tmp_path: Path) -> None:
    out, data = tmp_path / "project", ("--data", str(root))
    done = here("label", "export", "tasks", "--sample", "30", "--out", str(out), *data)
    assert done.code == 0, done.err
    tasks = {one["item_id"]: one for one in items(out)}
    whole = [one for one in tasks.values() if one["stratum"] == "none"]
    assert len(whole) >= 1
    assert all("start=" not in one["clip"] for one in whole)
    one, two, three, *rest = [one for one in tasks.values() if one["stratum"] != "none"]
    begin = 30.0 + int(one["item_id"], 16)
    assert f"start={begin:.0f}&amp;end={begin + 51:.0f}" in one["clip"]
    assert "<b>build &lt;" in one["about"]
    given = [
        (one, [judgement(1, is_task="yes", possible="no", begins_s=begin + 4, ends_s=begin + 90)]),
        (two, [judgement(1, is_task="yes", wording=["build  a farm\n"])]),
        (three, [judgement(1, is_task="no", begins_s=9.0, ends_s=3.0)]),
        *((left, [judgement(1, is_task="yes")]) for left in (*rest, *whole)),
    ]
    done = here("label", "import", str(exported(tmp_path / "e.json", given)), *data, "--json")
    assert done.code == 0, done.err
    assert json.loads(done.out.splitlines()[-1])["undefined"] == 2  # it ends before it begins
    said = read_measures(root / "pairs")["labels"]["task"]["questions"]
    assert said["is_task"]["n"] == 30
    assert said["is_task"]["share"] == pytest.approx(1 - three["weight"] / 36, abs=1e-3)
    assert (said["begins_s"]["n"], said["begins_s"]["share"]) == (1, 1)  # 4 s off is near
    assert (said["ends_s"]["n"], said["ends_s"]["share"]) == (1, 0)  # 39.5 s are not
    card = " ".join(judgements(read_measures(root / "pairs"), "task"))
    assert "Is the prompt a task? Yes for" in card
    assert "Within 10 s of start_s for 100.0%" in card
    assert said["wording"]["answers"] == 1
    with connect(root) as db:
        sql = "SELECT answer FROM labels WHERE question IN ('wording', 'begins_s') ORDER BY 1"
        found = [row["answer"] for row in select(db, sql).read_all().to_pylist()]
    assert found == [f"{begin + 4:g}", "build a farm"]
