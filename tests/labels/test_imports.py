"""`kb label import`: what people answered becomes rows and figures, once, and nobody's name."""

import json
import shutil
from pathlib import Path
from typing import Any

import duckdb
import numpy as np
import pytest

from kb.artifacts import release_folder
from kb.artifacts.measures import read_measures
from kb.core.context import Run
from kb.core.progress import Progress
from kb.labels.agreement import agreement
from kb.labels.export import export
from kb.labels.questions import PAIRS
from kb.query import connect, select
from kb.release.metadata.quality import pair_quality
from kb.store.state import tombstones
from kb.verify.root import verify
from tests.inprocess import Here
from tests.labels.answers import exported, items, judgement

ANN = {"id": 7, "email": "ann@example.org", "first_name": "Ann", "last_name": "Example"}


@pytest.fixture
def root(judged: Run, tmp_path: Path) -> Path:
    """A copy of the data root, and a project of 40 pairs beside it."""
    shutil.copytree(judged.root, tmp_path / "data")
    export(judged, PAIRS, 40, 0, tmp_path / "project")
    return tmp_path / "data"


def _labels(root: Path) -> list[dict[str, Any]]:
    with connect(root) as db:
        return select(db, "FROM labels").read_all().to_pylist()


def _card(root: Path) -> str:
    folder = release_folder.read_release_folder(root / "release" / "pairs", "pairs")
    with duckdb.connect() as con:
        return " ".join(pair_quality(con, root, folder))


def _bytes(root: Path) -> dict[str, bytes]:
    return {one.name: one.read_bytes() for one in (root / "labels").glob("*.parquet")}


def test_answers_become_rows_and_weighted_shares(root: Path, here: Here) -> None:
    """One stratum is judged good and the others bad: the share is that stratum's part of all."""
    assert "Not judged yet: nobody has looked at a sample of these pairs" in _card(root)
    tasks = items(root.parent / "project")
    good = tasks[0]["stratum"]
    answers = [
        (one, [judgement(n, visible="yes" if one["stratum"] == good else "no") for n in (1, 2)])
        for one in tasks
    ]
    file = exported(root.parent / "e.json", answers)
    done = here("label", "import", str(file), "--data", str(root), "--json")
    assert done.code == 0, done.err
    summary = json.loads(done.out.splitlines()[-1])
    assert (summary["answers"], summary["labels"]) == (80, 80)
    one = read_measures(root / "pairs")["labels"]["pair"]["questions"]["visible"]
    weights = dict.fromkeys((good, ""), 0.0)
    for task in tasks:
        weights[good if task["stratum"] == good else ""] += task["weight"]
    assert one["share"] == pytest.approx(weights[good] / sum(weights.values()), abs=1e-3)
    assert one["low"] < one["share"] < one["high"]
    assert (one["n"], one["covered"]) == (40, 1)
    assert one["agreement"]["kappa"] == 1
    said = _card(root)
    assert (
        f"visible in the clip? Yes for {one['share']:.1%} (95 % interval {one['low']:.1%}" in said
    )
    assert "n = 40); Cohen's kappa 1.00 over 40." in said
    assert "Is the time right?" not in said  # nobody answered
    assert f"pair\tvisible\t40\t{one['share']:.3f} (" in done.out
    assert not verify(root, Progress()).entries


def test_repeated_imports_and_other_orders_give_the_same_bytes(root: Path, here: Here) -> None:
    one, two, three, *_ = items(root.parent / "project")
    first = [(one, [judgement(1, visible="no", on_time="late")]), (two, [judgement(1, 5)])]
    later = [(one, [judgement(1, 9, visible="yes"), judgement(2, visible="no")])]
    other = [(three, [judgement(1, skipped=True, visible="yes")])]
    files = [
        str(exported(root.parent / f"{n}.json", tasks))
        for n, tasks in enumerate((first, later, other))
    ]
    made = []
    for order in (files, files[:1], files[::-1]):
        done = here("label", "import", *order, "--data", str(root), "--json")
        assert done.code == 0, done.err
        made.append((_bytes(root), json.loads(done.out.splitlines()[-1])))
    assert made[0][0] == made[1][0] == made[2][0]
    assert [summary["added"] for _, summary in made] == [2, 0, 0]
    said = made[0][1]
    assert (said["skipped"], said["contradictory"]) == (2, 1)
    rows = [(one["annotator"], one["question"], one["answer"]) for one in _labels(root)]
    assert rows == [(1, "visible", "yes"), (2, "visible", "no")]  # a new judgement replaces the old


def test_pairs_that_are_made_again_have_the_figures_of_what_was_judged(
    root: Path, here: Here
) -> None:
    """After a merge, from a backup or by other rules: the figures are derived from the answers."""
    judged = [(data, [judgement(1, visible="yes")]) for data in items(root.parent / "project")]
    file, at = exported(root.parent / "e.json", judged), ("--data", str(root))
    assert here("label", "import", str(file), *at).code == 0
    whole = (root / "pairs" / "measures.json").read_bytes()
    shutil.rmtree(root / "pairs")
    assert here("pairs", *at).code == 0
    assert (root / "pairs" / "measures.json").read_bytes() == whole
    assert "one person judged 40 pairs" in _card(root)
    shutil.move(root / "labels", root.parent / "labels")
    assert here("pairs", "--again", *at).code == 0
    assert "Not judged yet" in _card(root)
    shutil.move(root.parent / "labels", root / "labels")
    assert here("pairs", *at).code == 0  # which are up to date
    assert (root / "pairs" / "measures.json").read_bytes() == whole


def test_names_of_people_stay_out(root: Path, here: Here) -> None:
    one, two, *_ = items(root.parent / "project")
    person = [(one, [judgement(ANN, visible="yes")]), (two, [judgement(None, visible="no")])]
    file = exported(root.parent / "e.json", person)
    assert here("label", "import", str(file), "--data", str(root)).code == 0
    assert {one["annotator"] for one in _labels(root)} == {7, 0}
    for path in (*(root / "labels").iterdir(), root / "pairs" / "measures.json"):
        assert b"Ann" not in path.read_bytes()
        assert b"example.org" not in path.read_bytes()


def test_a_purge_takes_answers_of_a_video_with_it(root: Path, here: Here) -> None:
    gone, *others = items(root.parent / "project")
    one, two, *_ = [other for other in others if other["video_id"] != gone["video_id"]]
    tasks = [(data, [judgement(1, visible="yes")]) for data in (one, gone, two | {"item_id": "0"})]
    file = exported(root.parent / "e.json", tasks)
    assert here("label", "import", str(file), "--data", str(root)).code == 0
    assert {row["item_id"] for row in _labels(root)} == {one["item_id"], gone["item_id"]}
    (root.parent / "gone.txt").write_text(gone["video_id"])
    purge = ("purge", "youtube", "--ids", str(root.parent / "gone.txt"), "--data", str(root))
    assert "labels" in here(*purge, "--plan").out
    assert here(*purge).code == 1  # there are no raw data to make the pairs of
    assert [row["item_id"] for row in _labels(root)] == [one["item_id"]]
    assert not verify(root, Progress()).entries


def test_purged_and_unknown_items_are_passed_over(root: Path, here: Here) -> None:
    gone, *others = items(root.parent / "project")
    one, two, *_ = [other for other in others if other["video_id"] != gone["video_id"]]
    tasks = [(data, [judgement(1, visible="yes")]) for data in (one, gone, two | {"item_id": "0"})]
    file = exported(root.parent / "e.json", tasks)
    tombstones.add_tombstones(root, "youtube", [(gone["video_id"], "named")])
    done = here("label", "import", str(file), "--data", str(root), "--json")
    summary = json.loads(done.out.splitlines()[-1])
    assert (summary["purged_items"], summary["unknown_items"]) == (1, 1)
    assert [row["item_id"] for row in _labels(root)] == [one["item_id"]]


def test_answers_that_no_question_has_are_counted(root: Path, here: Here) -> None:
    one, two, *_ = items(root.parent / "project")
    given = [
        (one, [judgement(1, visible="perhaps", mood="yes", on_time="The clip is too late")]),
        (two, [judgement(1, visible="unsure", described="partly")]),
    ]
    file = exported(root.parent / "e.json", given)
    done = here("label", "import", str(file), "--data", str(root), "--json")
    assert json.loads(done.out.splitlines()[-1])["undefined"] == 2
    questions = read_measures(root / "pairs")["labels"]["pair"]["questions"]
    assert questions["on_time"]["answers"] == {"late": 1}
    assert (questions["visible"]["n"], questions["visible"]["share"]) == (0, None)
    assert (questions["described"]["n"], questions["described"]["share"]) == (1, 0)


def test_an_odd_judgement_keeps_no_other_from_being_taken(root: Path, here: Here) -> None:
    one, two, three, four, *_ = items(root.parent / "project")
    of_version_1 = judgement("ann@example.org", visible="yes") | {"was_cancelled": None}
    nobody = judgement(1, visible="no") | {"created_at": 1_700_000_000, "updated_at": "soon"}
    del nobody["completed_by"]
    odd = [judgement(1) | {"result": None}, judgement(2) | {"result": [None, {"value": 5}]}]
    moment = judgement("ben@example.org", visible="yes") | {"updated_at": 1_700_000_000_123}
    given = [(one, [of_version_1]), (two, [nobody]), (three, odd), (four, [moment])]
    file = exported(root.parent / "e.json", given)
    done = here("label", "import", str(file), "--data", str(root), "--json")
    summary = json.loads(done.out.splitlines()[-1])
    assert (done.code, summary["labels"], summary["no_result"]) == (0, 3, 1)
    rows = {row["item_id"]: row for row in _labels(root)}
    assert rows[two["item_id"]]["annotator"] == 0
    assert rows[two["item_id"]]["labelled_at"].timestamp() == 1_700_000_000
    assert rows[four["item_id"]]["labelled_at"].timestamp() == pytest.approx(1_700_000_000.123)
    assert len({row["annotator"] for row in rows.values()}) == 3
    assert all(b"example.org" not in data for data in _bytes(root).values())


@pytest.mark.parametrize(
    "text",
    [
        "",
        "{}",
        '[{"item_id": "a", "kind": "pair", "visible": "yes"}]',  # JSON-MIN
        '[{"data": {"text": "another project"}, "annotations": []}]',
        '[{"data": {"item_id": "a", "kind": "pot", "video_id": "b"}, "annotations": []}]',
        '[{"data": {"item_id": "a", "kind": "pair", "video_id": "b"}}]',  # what was judged
    ],
)
def test_a_file_that_is_no_export_loses_nothing(root: Path, here: Here, text: str) -> None:
    one, *_ = items(root.parent / "project")
    good = exported(root.parent / "e.json", [(one, [judgement(1, visible="yes")])])
    assert here("label", "import", str(good), "--data", str(root)).code == 0
    before = _bytes(root), read_measures(root / "pairs")
    newer = exported(root.parent / "n.json", [(one, [judgement(1, 1, visible="no")])])
    (root.parent / "bad.json").write_text(text)
    done = here("label", "import", str(newer), str(root.parent / "bad.json"), "--data", str(root))
    assert done.code == 2
    assert "bad.json is not an export" in done.said
    assert done.err.count("\n") == 1
    assert (_bytes(root), read_measures(root / "pairs")) == before


def test_an_export_with_a_byte_order_mark_is_read(root: Path, here: Here) -> None:
    one, *_ = items(root.parent / "project")
    file = exported(root.parent / "e.json", [(one, [judgement(1, visible="yes")])])
    text = json.dumps(json.loads(file.read_text()), indent=1)
    file.write_text(text, encoding="utf-8-sig", newline="\r\n")
    done = here("label", "import", str(file), "--data", str(root), "--json")
    assert (done.code, json.loads(done.out.splitlines()[-1])["labels"]) == (0, 1)


def test_cohens_kappa_of_a_known_table() -> None:
    """Two readers of 50 grant proposals: 20 both yes, 15 both no, 5 and 10 apart: 0.4."""
    pairs = [(1, 1)] * 20 + [(1, 0)] * 5 + [(0, 1)] * 10 + [(0, 0)] * 15 + [(1, -1)] * 9
    found = agreement(np.array(pairs), 2)
    assert found == {"method": "cohen", "items": 50, "agreed": 0.7, "kappa": 0.4}


def test_fleiss_kappa_of_a_known_table() -> None:
    """Fourteen people, ten subjects, five categories (Fleiss's example as it is taught): 0.210."""
    counts = [
        [0, 0, 0, 0, 14],
        [0, 2, 6, 4, 2],
        [0, 0, 3, 5, 6],
        [0, 3, 9, 2, 0],
        [2, 2, 8, 1, 1],
        [7, 7, 0, 0, 0],
        [3, 2, 6, 3, 0],
        [2, 5, 3, 2, 2],
        [6, 5, 2, 1, 0],
        [0, 2, 2, 3, 7],
    ]
    found = agreement(np.array([np.repeat(range(5), row) for row in counts]), 5)
    assert (found["method"], found["items"]) == ("fleiss", 10)
    assert found["kappa"] == pytest.approx(0.210, abs=5e-4)
    assert found["agreed"] == pytest.approx(0.378, abs=5e-4)


def test_nothing_is_said_where_nothing_is_shared_or_differs() -> None:
    assert agreement(np.array([[0, -1], [-1, 1]]), 2)["items"] == 0
    assert agreement(np.array([[0, 0], [0, 0]]), 1)["kappa"] is None


@pytest.mark.parametrize("annotation", [None, 5, "text", [], {}, {"result": None}, {"result": {}}])
def test_an_annotation_without_a_result_costs_itself(
    root: Path, here: Here, annotation: Any
) -> None:
    first, second, *_ = items(root.parent / "project")
    given = [(first, [annotation, judgement(1, visible="yes")]), (second, [annotation])]
    file = exported(root.parent / "e.json", given)
    done = here("label", "import", str(file), "--data", str(root), "--json")
    summary = json.loads(done.out.splitlines()[-1])
    assert (done.code, summary["labels"]) == (0, 1)
    assert (summary["no_result"], summary["no_annotations"], summary["skipped"]) == (2, 0, 0)


def test_a_task_without_annotations_costs_itself(root: Path, here: Here) -> None:
    first, *others = items(root.parent / "project")
    tasks: list[dict[str, Any]] = [{"data": data} for data in others[:3]]
    tasks[1]["annotations"], tasks[2]["annotations"] = None, "none"
    file = root.parent / "e.json"
    file.write_text(
        json.dumps([*tasks, {"data": first, "annotations": [judgement(1, visible="yes")]}])
    )
    done = here("label", "import", str(file), "--data", str(root), "--json")
    summary = json.loads(done.out.splitlines()[-1])
    assert (done.code, summary["labels"], summary["no_annotations"]) == (0, 1, 3)
