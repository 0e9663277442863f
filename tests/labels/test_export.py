"""`kb label export`: a project that Label Studio takes, and a sample that stands for the whole."""

import json
import re
import shutil
import xml.etree.ElementTree as ET
from collections import Counter
from dataclasses import replace
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from kb.artifacts import freshness, manifest
from kb.artifacts.measures import read_measures
from kb.core.context import Run
from kb.labels.export import CONFIG, README, TASKS, export
from kb.labels.questions import KINDS, PAIRS, UNSURE, YES
from kb.query import connect, select
from kb.release.metadata.quality import judgements
from kb.schema.tables import table
from kb.store.tables.shard_writer import write_table
from tests.inprocess import Here
from tests.labels.answers import exported, items, judgement

SOURCES = ["chapter"] * 12 + ["transcript"] * 20 + ["none"] * 4


def _tasks(folder: Path) -> list[dict[str, Any]]:
    return [one["data"] for one in json.loads((folder / TASKS).read_text())]


def test_the_project_agrees_with_itself(judged: Run, tmp_path: Path) -> None:
    """Every variable of the configuration is in every task, and every question is about an object
    of the page. label-studio-sdk would say the same, but its packages contradict those of the lock;
    `make test-label` asks the real Label Studio.
    """
    export(judged, PAIRS, 30, 0, tmp_path / "out")
    config = (tmp_path / "out" / CONFIG).read_text()
    page = ET.fromstring(config)
    shown = {one.get("name") for one in page.iter("HyperText")}
    asked = {one.get("name"): one for one in page.iter("Choices")}
    questions = [one for one in PAIRS.questions if not one.aligned]
    assert set(asked) == {one.name for one in questions}
    assert {one.get("toName") for one in asked.values()} <= shown
    for question in questions:
        names = [one.get("alias") for one in asked[question.name]]
        assert names == [name for name, _ in question.options]
    for task in _tasks(tmp_path / "out"):
        assert set(re.findall(r'value="\$(\w+)"', config)) <= task.keys()
    readme = (tmp_path / "out" / README).read_text()
    assert all(one.text in readme and one.help in readme for one in PAIRS.questions)


def test_the_sample_stands_for_all_pairs(judged: Run, tmp_path: Path) -> None:
    summary = export(judged, PAIRS, 40, 0, tmp_path / "out")
    tasks = _tasks(tmp_path / "out")
    with connect(judged.root) as db:
        sql = "SELECT keyword_kind || ' ' || timing AS stratum, count(*) AS n FROM pairs GROUP BY 1"
        sizes = {one["stratum"]: one["n"] for one in select(db, sql).read_all().to_pylist()}
        rows = {one["pair_id"]: one for one in select(db, "FROM pairs").read_all().to_pylist()}
    weights = Counter[str]()
    for task in tasks:
        weights[task["stratum"]] += task["weight"]
        row = rows[task["item_id"]]
        begin, end = map(int, re.findall(r"(?:start|end)=(\d+)", task["clip"]))
        assert f"https://www.youtube.com/embed/{row['video_id']}?" in task["clip"]
        assert begin <= row["clip_start_s"] < begin + 1
        assert end - 1 < row["clip_end_s"] <= end
    assert len(sizes) > 1
    assert weights == {name: pytest.approx(n, abs=0.01) for name, n in sizes.items()}
    assert summary["out_of"] == len(rows)
    assert len({one["item_id"] for one in tasks}) == summary["items"] == 40


def test_texts_stand_in_their_surroundings_and_are_escaped(judged: Run, tmp_path: Path) -> None:
    export(judged, PAIRS, 400, 0, tmp_path / "out")
    pages = [one["about"] for one in _tasks(tmp_path / "out")]
    assert any(re.search(r"<p>\w.* <b>.+</b> \w.*</p>", page) for page in pages)
    for page in pages:
        assert set(re.findall(r"</?[^>]*>", page)) <= {"<p>", "</p>", "<b>", "</b>"}


def test_a_larger_sample_begins_with_the_smaller_one(judged: Run, tmp_path: Path) -> None:
    for name, size, seed in (("a", 20, 0), ("b", 40, 0), ("c", 20, 1), ("d", 20, 0)):
        export(judged, PAIRS, size, seed, tmp_path / name)
    ids = {name: [one["item_id"] for one in _tasks(tmp_path / name)] for name in "abcd"}
    assert ids["b"][:20] == ids["a"]
    assert set(ids["c"]) != set(ids["a"])
    for name in (CONFIG, TASKS, README):
        assert (tmp_path / "a" / name).read_bytes() == (tmp_path / "d" / name).read_bytes()


def test_a_downloaded_release_has_no_text_to_ask_about(
    judged: Run, tmp_path: Path, here: Here
) -> None:
    download = judged.root / "release" / "pairs"
    before = sorted(download.iterdir())
    words = ("label", "export", "pairs", "--sample", "9", "--out", str(tmp_path / "out"))
    assert here(*words, "--data", str(download)).code == 0
    inside = here(*words[:-1], str(download / "label-pairs"), "--data", str(download))
    assert inside.code == 2
    assert "which this command only reads" in inside.said
    assert sorted(download.iterdir()) == before
    assert 'name="described"' not in (tmp_path / "out" / CONFIG).read_text()
    assert len(_tasks(tmp_path / "out")) == 9


def test_other_folders_are_not_replaced(judged: Run, tmp_path: Path, here: Here) -> None:
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "README.md").write_text("mine")
    words = ("label", "export", "pairs", "--data", str(judged.root))
    done = here(*words, "--out", str(tmp_path / "mine"))
    assert done.code == 2
    assert "is not a labelling project" in done.said
    assert (tmp_path / "mine" / "README.md").read_text() == "mine"
    assert here(*words, "--out", str(tmp_path / "mine" / "new")).code == 0
    assert here(*words, "--out", str(tmp_path / "mine" / "new"), "--seed", "1").code == 0


@pytest.mark.parametrize("kind", ["pairs", "tasks"])
def test_an_empty_project_is_not_written(
    kind: str, judged: Run, root: Path, here: Here, tmp_path: Path
) -> None:
    inputs = manifest.inputs(root, kind)
    settings = freshness.settings(replace(judged, root=root), kind)
    with manifest.replacing(root, kind, inputs=inputs, settings=settings) as fresh:
        empty = table(f"{kind}/{kind}").arrow().empty_table()
        write_table(fresh.folder / f"{kind}-00000-of-00001.parquet", empty, f"{kind}/{kind}")
    words = ("label", "export", kind, "--data", str(root), "--out", str(tmp_path / "out"))
    done = here(*words)
    assert (done.code, (tmp_path / "out").exists()) == (1, False)
    assert f"there are no {kind} to judge" in done.said


def test_pairs_of_another_data_root_make_no_project(
    judged: Run, here: Here, tmp_path: Path
) -> None:
    pq.write_table(pa.table({"pair_id": ["ab" * 8]}), tmp_path / "pairs.parquet")
    words = ("label", "export", "pairs", "--data", str(judged.root))
    more = ("--pairs", str(tmp_path / "pairs.parquet"), "--out", str(tmp_path / "out"))
    done = here(*words, *more)
    assert (done.code, (tmp_path / "out").exists()) == (1, False)
    assert "there are no pairs to judge" in done.said


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
        start_mined_s=times,
        end_mined_s=[None if one is None else one + 50.5 for one in times],
    )
    root = tmp_path / "data"
    inputs = manifest.inputs(root, "tasks")
    settings = freshness.settings(replace(judged, root=root), "tasks")
    with manifest.replacing(root, "tasks", inputs=inputs, settings=settings) as fresh:
        write_table(fresh.folder / "tasks-00000-of-00001.parquet", rows, "tasks/tasks")
    return root


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
