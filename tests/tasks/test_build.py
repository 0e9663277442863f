"""`kb tasks` as a user: the tables, MineDojo's file, a purge, and a run that finds nothing new."""

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import duckdb
import pyarrow as pa
import pytest
import yaml

from kb.artifacts import release_folder
from kb.pairs.transcript_batch import Text
from kb.release.metadata.quality import task_quality
from kb.sandbox.world import World
from kb.tasks.build import by_chapter, by_mentions, chapters
from tests.faults import Sandbox
from tests.labels.answers import exported, judgement
from tests.youtube.job import Job

SCHEMA = {"collection", "guidance", "prompt", "source"}

LISTED = """A tour.

0:00 Hello
1:05 - Building the iron farm
1:02:03 | Goodbye
"""


@pytest.fixture(scope="module")
def job(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Job]:
    world = World(n_channels=9, n_videos=150)
    with Sandbox(world, services=["youtube"]) as sandbox:
        job = Job(sandbox, tmp_path_factory.mktemp("tasks"))
        job.done("youtube", "crawl")
        job.done("youtube", "filter")
        job.done("tasks")
        yield job


def _rows(job: Job, sql: str) -> list[tuple]:
    return duckdb.sql(sql.replace("$", str(job.root))).fetchall()


def test_every_title_is_a_task_or_has_a_reason(job: Job) -> None:
    kept = _rows(job, "SELECT video_id FROM '$/clean/youtube/videos/*.parquet' ORDER BY 1")
    both = "FROM read_parquet('$/tasks/*.parquet') SELECT video_id ORDER BY 1"
    assert _rows(job, both) == kept
    reasons = "FROM '$/tasks/titles-*.parquet' SELECT DISTINCT rejected_reason, reasons[1]"
    assert all(one == first is not None for one, first in _rows(job, reasons))


def test_planted_tasks_are_found_where_their_chapters_begin(job: Job) -> None:
    truth = {one["video_id"]: one for one in job.sandbox.world.truth["tasks"]}
    columns = "video_id, prompt, start_s, start_source"
    found = _rows(job, f"FROM '$/tasks/tasks-*.parquet' SELECT {columns}")
    prompts = {one["prompt"] for one in truth.values()}
    assert {prompt for _, prompt, _, _ in found} == prompts
    assert all(truth[video]["prompt"] == prompt for video, prompt, _, _ in found)
    listed = [(video, start) for video, _, start, how in found if how == "chapter"]
    assert listed
    assert all(truth[video]["start_s"] == start for video, start in listed)
    assert sum(not start for _, _, start, _ in found) < len(found) / 2


def test_of_equal_prompts_the_first_published_video_has_it(job: Job) -> None:
    sql = """SELECT bool_and(first.published_at <= later.published_at), count(*)
        FROM '$/tasks/titles-*.parquet' AS copy JOIN '$/tasks/tasks-*.parquet' AS task
            ON replace(copy.prompt, ' the ', ' a ') = replace(task.prompt, ' the ', ' a ')
        JOIN '$/clean/youtube/videos/*.parquet' AS first ON task.video_id = first.video_id
        JOIN '$/clean/youtube/videos/*.parquet' AS later ON copy.video_id = later.video_id
        WHERE copy.rejected_reason = 'duplicate'"""
    ((ordered, count),) = _rows(job, sql)
    assert ordered
    assert count


def test_the_release_has_prompts_and_no_reasons(job: Job) -> None:
    ((columns,),) = _rows(
        job,
        "SELECT list(column_name) FROM (DESCRIBE FROM '$/release/tasks/tasks-*.parquet')",
    )
    assert {"prompt", "video_id", "start_s", "end_s"} <= set(columns)
    assert not {"reasons", "rejected_reason"} & set(columns)


def test_minedojo_reads_every_task(job: Job) -> None:
    job.done("tasks", "--format", "minedojo")
    path = job.root / "export/minedojo/creative_tasks.yaml"
    read = yaml.safe_load(path.read_text())
    found = _rows(job, "FROM '$/tasks/tasks-*.parquet' SELECT prompt, video_id ORDER BY video_id")
    made = [(one["prompt"], one["source"]["youtube_id"]) for one in read.values()]
    assert made == found
    assert list(read) == [f"creative:{number}" for number in range(len(found))]
    assert all(set(one) == SCHEMA for one in read.values())
    assert all(0 <= one["source"]["start"] < one["source"]["end"] for one in read.values())


def test_the_same_titles_are_not_mined_again(job: Job) -> None:
    before = _digests(job.root)
    assert job.done("tasks")["tasks"] > 10
    assert _digests(job.root) == before
    job.done("tasks", "--again")
    assert {name: data for name, (data, _) in _digests(job.root).items()} == {
        name: data for name, (data, _) in before.items()
    }


def _digests(root: Path) -> dict[str, tuple[bytes, int]]:
    files = (root / "tasks").glob("*.parquet")
    return {one.name: (one.read_bytes(), one.stat().st_mtime_ns) for one in files}


def test_a_damaged_file_is_found_and_made_again(job: Job) -> None:
    (path,) = (job.root / "tasks").glob("tasks-*.parquet")
    whole = path.read_bytes()
    path.write_bytes(whole[:-200] + bytes(200))
    damaged = job.done("verify", code=1)
    assert [str(path)] == [one["path"] for one in damaged["found"]]
    job.done("verify", "--repair")
    assert path.read_bytes() == whole


def test_purged_videos_leave_every_place(job: Job, tmp_path: Path) -> None:
    ((gone,),) = _rows(job, "FROM '$/tasks/tasks-*.parquet' SELECT min(video_id)")
    job.done("tasks", "--format", "minedojo")
    ids = tmp_path / "ids.txt"
    ids.write_text(gone)
    job.done("purge", "youtube", "--ids", str(ids))
    for place in ("tasks/*.parquet", "release/tasks/*-of-*.parquet"):
        assert not _rows(job, f"FROM '$/{place}' SELECT 1 WHERE video_id = '{gone}'")
    assert gone not in (job.root / "export/minedojo/creative_tasks.yaml").read_text()
    assert json.loads((job.root / "tasks/_manifest.json").read_text())["rules"]


def _project(job: Job) -> list[dict[str, Any]]:
    """`data` of every task of a project for Label Studio."""
    job.done("label", "export", "tasks", "--sample", "9999", "--out", "project")
    return [one["data"] for one in json.loads((job.place / "project/tasks.json").read_text())]


def test_what_people_say_of_tasks_counts(job: Job) -> None:
    """An import is a reason for `kb build`; rejected tasks go, wordings and times replace the mined
    ones, and figures stay those of what was found.
    """
    job.done("build", "tasks")
    mined = _rows(job, "FROM '$/tasks/tasks-*.parquet' SELECT task_id, prompt, start_s")
    items = _project(job)
    listed = [one for one in items if "<br>0:00 Hello<br>" in one["description"]]
    assert listed, "no description has its chapters"
    no, tie, possible, worded, timed = items[:5]
    given = [
        (no, [judgement(1, is_task="no"), judgement(2, is_task="no", wording=["build it"])]),
        (tie, [judgement(1, is_task="no"), judgement(2, is_task="yes", possible="unsure")]),
        (possible, [judgement(1, is_task="yes", possible="no")]),
        (
            worded,
            [
                judgement(1, 0, is_task="yes", wording=["build a first one"]),
                judgement(2, 5, is_task="unsure", wording=["build  a better one"]),
                judgement(3, 9, is_task="no", wording=["build the last one"]),
            ],
        ),
        (timed, [judgement(n, begins_s=at, ends_s=at + 9) for n, at in ((1, 2.0), (2, 5.0))]),
    ]
    file = str(exported(job.place / "answers.json", given))
    said = job.done("label", "import", file)["figures"]["task"]["questions"]
    (step,) = [
        one for one in job.done("build", "--plan", "tasks")["steps"] if "labels" in one["reasons"]
    ]
    assert step["artifact"] == "tasks"
    assert job.done("release", code=1)
    job.done("build", "tasks")
    sql = """FROM '$/release/tasks/tasks-*.parquet'
        SELECT task_id, prompt, prompt_mined, start_s, end_s, judged, n_judges"""
    rows = {row[0]: row[1:] for row in _rows(job, sql)}
    assert {one for one, *_ in mined} - rows.keys() == {no["item_id"], possible["item_id"]}
    assert rows[worded["item_id"]][:2] == ("build a better one", worded["prompt"])
    assert rows[timed["item_id"]][2:] == (3.5, 12.5, True, 2)
    assert rows[tie["item_id"]][0] == tie["prompt"]
    assert sum(judged for *_, judged, _ in rows.values()) == 3
    gone = "FROM '$/tasks/titles-*.parquet' SELECT task_id WHERE rejected_reason = 'judged'"
    assert {one for (one,) in _rows(job, gone)} == {no["item_id"], possible["item_id"]}
    job.done("tasks", "--format", "minedojo")
    read = yaml.safe_load((job.root / "export/minedojo/creative_tasks.yaml").read_text())
    prompts = [one["prompt"] for one in read.values()]
    assert "build a better one" in prompts
    assert not {no["prompt"], possible["prompt"], worded["prompt"]} & set(prompts)
    # A second import finds the same, although two tasks have left the table.
    assert job.done("label", "import", file)["figures"]["task"]["questions"] == said
    job.done("tasks", "--again")
    assert {row[0]: row[1:] for row in _rows(job, sql)} == rows
    folder = release_folder.read_release_folder(job.root / "release/tasks", "tasks")
    with duckdb.connect() as con:
        card = " ".join(task_quality(con, job.root, folder))
    assert f"people judged 5 of {len(mined)} mined tasks. Left out" in card
    assert "or possible: 2; with a wording of theirs (`prompt_mined` has the title's): 1." in card


def test_chapters_are_lines_with_times_from_zero_on() -> None:
    found = chapters(LISTED, 4000.0)
    assert found == [(0, "Hello"), (65, "Building the iron farm"), (3723, "Goodbye")]
    assert chapters(LISTED, 100.0) == found[:2]


@pytest.mark.parametrize("text", ["", "1:05 the best part", "0:10 a\n0:20 b", "0:00 a\n0:00 b"])
def test_other_times_are_no_chapters(text: str) -> None:
    assert chapters(text, None) == []


def test_the_chapter_that_names_the_object_has_the_task() -> None:
    listed = chapters(LISTED, 4000.0)
    assert by_chapter(listed, ("simple", "iron", "farm"), 4000.0) == (65, 3723)
    assert by_chapter(listed, ("goodbye",), 4000.0) == (3723, 4000)
    assert by_chapter(listed, ("castle",), 4000.0) is None


def _said(*cues: tuple[float, str]) -> Text:
    cells = [{"start_s": at, "duration_s": 4.0, "text": text} for at, text in cues]
    return Text(pa.table({"video_id": ["v"], "kind": ["manual"], "cues": pa.array([cells])}))


def _times(words: tuple[str, ...], *cues: tuple[float, str]) -> tuple[float, float] | None:
    (found,) = by_mentions(_said(*cues), [words], 60)
    return found


def test_a_task_begins_with_mentions_that_have_company() -> None:
    """A castle is announced in the first second, and built from second 100 on."""
    cues = (
        (0, "castles today my friends"),
        (100, "a castle needs walls"),
        (150, "now this Castle is done"),
        (500, "look at the castle again"),
    )
    assert _times(("giant", "castle"), *cues) == (101.0, 154.0)


def test_the_longest_name_that_is_spoken_counts() -> None:
    cues = ((5, "a farm"), (20, "an iron farm"), (40, "the iron farm"))
    assert _times(("tiny", "iron", "farm"), *cues) == (21.333, 44.0)
    assert _times(("farmer",), *cues) is None


def test_one_mention_alone_is_its_cue() -> None:
    assert _times(("bow",), (7, "take a bow please"), (12, "and go")) == (9.0, 11.0)
