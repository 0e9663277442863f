"""What the two tracks of a video say of speech recognition, and `kb pairs measure` as a user."""

import json
import shutil
from collections.abc import Iterator
from typing import Any

import pyarrow as pa
import pytest

from kb.core.context import Run
from kb.pairs import keywords
from kb.pairs.measures import compare, sampled
from kb.pairs.transcript_batch import Text
from kb.sandbox.world import World
from tests.faults import Sandbox
from tests.youtube.job import Job

FOR_HOURS = {"Retry-After": "7200"}


def _track(kind: str, *cues: tuple[float, str]) -> Text:
    cells = [{"start_s": at, "duration_s": 2.0, "text": text} for at, text in cues]
    return Text(pa.table({"video_id": ["v"], "kind": [kind], "cues": pa.array([cells])}))


def test_a_word_counts_once_and_only_near_its_time(run: Run) -> None:
    known = keywords.load(run.profile)
    heard = _track("asr", (0, "a creeper came"), (5, "and a skeleton"), (60, "a creeper again"))
    wrote = _track("manual", (1, "a creeper came"), (6, "and a zombie"), (90, "a creeper again"))
    got = compare(heard, wrote, known)
    assert [len(got.automatic), len(got.manual), len(got.both)] == [3, 3, 1]
    assert got.later_s.tolist() == [pytest.approx(-1.0)]
    assert [known.every[one].name.lower() for one in got.both] == ["creeper"]


@pytest.fixture(scope="module")
def measured(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[Job, dict[str, Any]]]:
    with Sandbox(World(n_channels=9, n_videos=60), services=["youtube"]) as sandbox:
        job = Job(sandbox, tmp_path_factory.mktemp("measured"))
        job.done("youtube", "crawl")
        job.done("youtube", "filter")
        job.done("pairs")
        planned = job.done("pairs", "measure", "--plan")
        job.sandbox.faults.add("/watch", after=2, times=None, status=429, headers=FOR_HOURS)
        stopped = job.done("pairs", "measure", code=3)
        job.sandbox.faults.clear()
        done = job.done("pairs", "measure")
        yield job, {"plan": planned, "stopped": stopped, "done": done}


def test_it_asks_for_what_it_planned_and_for_nothing_twice(
    measured: tuple[Job, dict[str, Any]],
) -> None:
    job, said = measured
    both = said["plan"]["videos_with_both_tracks"]
    assert both > 2
    assert said["plan"]["requests"] == 3 * both
    stopped, done = said["stopped"], said["done"]
    assert stopped["fetched"] < both
    assert stopped["left"] == done["fetched"] == both - stopped["fetched"]
    assert done["videos_compared"] == both
    assert len(job.raw("second_tracks")) == both
    before = len(job.sandbox.ledger)
    assert job.done("pairs", "measure")["speech_recognition"] == said["done"]["speech_recognition"]
    smaller = job.done("pairs", "measure", "--sample", "2")
    assert smaller["speech_recognition"] == said["done"]["speech_recognition"]  # of all there are
    assert len(job.sandbox.ledger) == before
    measures = job.root / "pairs" / "measures.json"
    whole = measures.read_bytes()
    shutil.rmtree(measures.parent)
    job.done("pairs")
    assert measures.read_bytes() == whole


def test_the_section_counts_what_the_intervals_are_of(
    measured: tuple[Job, dict[str, Any]],
) -> None:
    job, said = measured
    text = (job.root / "pairs" / "measures.json").read_text()
    section = json.loads(text)["speech_recognition"]
    assert section == said["done"]["speech_recognition"]
    every, kinds = section["keywords"], section["keywords_by_kind"]
    for name in ("in_automatic", "in_manual", "in_both"):
        assert every[name] == sum(kind[name] for kind in kinds.values()) > 50
    for name, n in (
        ("manual_given_automatic", "in_automatic"),
        ("automatic_given_manual", "in_manual"),
    ):
        share = every[name]
        assert share["low"] < share["share"] < share["high"]
        assert share["share"] == pytest.approx(every["in_both"] / every[n], abs=1e-4)
    times = section["automatic_later_s"]
    assert times["n"] == every["in_both"]
    assert times["p05"] <= times["p50"] <= times["p95"]


def test_second_tracks_neither_age_the_filter_nor_show_ids(
    measured: tuple[Job, dict[str, Any]],
) -> None:
    job, _ = measured
    assert "kb youtube filter" not in job.kb("status").stdout
    text = (job.root / "pairs" / "measures.json").read_text()
    assert not [one for one in job.sandbox.world.youtube.videos if one in text]


def test_a_removed_video_leaves_the_second_tracks_as_well(
    measured: tuple[Job, dict[str, Any]],
) -> None:
    job, said = measured
    gone = job.raw("second_tracks")[0]["response"]["video_id"]
    (job.place / "gone.txt").write_text(gone)
    job.done("purge", "youtube", "--ids", str(job.place / "gone.txt"))
    assert gone not in [one["response"]["video_id"] for one in job.raw("second_tracks")]
    again = job.done("pairs", "measure")
    assert again["videos_with_both_tracks"] == said["plan"]["videos_with_both_tracks"] - 1
    assert not again["requests"]
    (left,) = job.rows("SELECT count(*) AS pairs FROM pairs")
    measures = json.loads((job.root / "pairs" / "measures.json").read_text())
    assert measures["pairs"]["pairs"] == measures["pairs"]["word_times"]["n"] == left["pairs"]


def test_a_larger_sample_begins_with_the_smaller_one(
    measured: tuple[Job, dict[str, Any]],
) -> None:
    job, _ = measured
    ids = {row["video_id"] for row in job.rows("SELECT video_id FROM clean.youtube_transcripts")}
    large, small = (sampled(job.root, ids, n, 7).ids for n in (6, 3))
    assert large[:3] == small
    assert sampled(job.root, ids, 6, 8).ids != large
