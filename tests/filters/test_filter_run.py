"""The clean runner on YouTube's own pipeline: raw segments in, four answers out."""

import dataclasses
import json
from pathlib import Path

import pytest

from kb.core import context, engine
from kb.core.errors import DamagedData, FatalError
from kb.filters.filter_run import run_clean
from kb.sandbox.world import World
from kb.store.layout import Layout
from kb.store.rawlog import rawlog
from kb.store.state.frontier import Frontier
from tests.faults import Sandbox
from tests.filters.made import (
    MONDAY,
    digests,
    listing,
    put,
    rows,
    run_at,
    video,
)
from tests.youtube.job import Job


def test_every_answer(root: Path) -> None:
    summary = run_clean(run_at(root), "youtube")
    assert {
        name: summary[name]
        for name in ("crawled", "kept", "rejected", "failed", "pending", "missing")
    } == {"crawled": 22, "kept": 2, "rejected": 17, "failed": 2, "pending": 1, "missing": 1}
    kept = rows(root, "videos")
    assert set(kept) == {"kept", "bare"}
    row = kept["kept"]
    assert row["link"] == "https://www.youtube.com/watch?v=kept"
    assert (row["width"], row["height"], row["fps"]) == (1920, 1080, 60)
    assert (
        row["topic_evidence"],
        row["transcript_kind"],
        row["word_count"],
        row["age_restricted"],
    ) == ("game_label", "asr", 3, False)
    assert (row["toxicity_title"], row["toxicity_title_insult"]) == (None, None)
    row = kept["bare"]
    assert (row["width"], row["height"], row["fps"], row["topic_evidence"]) == (
        854,
        480,
        None,
        "keywords",
    )
    tracks = rows(root, "transcripts")
    assert set(tracks) == {"kept", "bare"}
    cue = {"start_s": 1.0, "duration_s": 2.0, "text": "three", "word_start_s": None}
    assert tracks["kept"]["cues"][1] == cue
    rejected = {
        key: (row["stage"], row["reason"], row["value"], row["threshold"])
        for key, row in rows(root, "rejected").items()
    }
    assert rejected == {
        "gone": ("missing", "missing", None, None),
        "unlisted": ("not_public", "unlisted", "unlisted", None),
        "category": ("topic", "category", "22", "20"),
        "words": ("topic", "keywords", None, "20"),
        "roblox": ("topic", "other_game", "Roblox", "20"),
        "few": ("views", "below", "99", "100"),
        "hidden": ("views", "below", "5", "100"),
        "noviews": ("views", "absent", None, "100"),
        "minus": ("views", "malformed", "-5", "100"),
        "tall": ("aspect_ratio", "below", "0.5625", "1"),
        "noshape": ("aspect_ratio", "absent", None, "1"),
        "live": ("duration", "below", "0", "60"),
        "odd": ("duration", "malformed", "5 minutes", "60"),
        "rated": ("age_restricted", "age_restricted", None, None),
        "restricted": ("age_restricted", "age_restricted", None, None),
        "none": ("transcript", "none", "none", None),
        "disabled": ("transcript", "disabled", "disabled", None),
    }
    assert {key: row["reason"] for key, row in rows(root, "pending").items()} == {"unread": "label"}
    assert {key: row["reason"] for key, row in rows(root, "failed").items()} == {
        "broken": "label",
        "badcues": "label",
    }
    assert summary["toxicity"] == "not scored"
    assert json.loads((root / "clean/youtube/summary.json").read_text())["stages"]["views"] == 4


def test_transcripts_optional(root: Path) -> None:
    run_clean(run_at(root, transcripts="optional"), "youtube")
    kept = rows(root, "videos")
    assert set(kept) == {"kept", "bare", "none", "disabled"}
    assert (kept["none"]["transcript_kind"], kept["none"]["word_count"]) == ("none", None)
    run_clean(run_at(root, transcripts="optional", game_ids=()), "youtube")
    kept = rows(root, "videos")
    assert set(kept) == {
        "kept",
        "bare",
        "none",
        "disabled",
        "unread",
        "broken",
        "badcues",
        "roblox",
    }
    assert {kept[key]["transcript_kind"] for key in ("unread", "broken", "badcues")} == {"unknown"}
    assert set(rows(root, "pending")) == set()


def test_unknown_keys_are_counted(root: Path) -> None:
    put(
        root,
        "videos",
        (
            MONDAY,
            {},
            listing(
                video("new", snippet__mood="fine"), video("new2", snippet__mood="fine", aura=1)
            ),
        ),
    )
    summary = run_clean(run_at(root), "youtube")
    assert summary["unknown_keys"] == {"videos.items[].snippet.mood": 2, "videos.items[].aura": 1}


def test_a_cut_off_segment_is_named_and_no_table_is_made_of_the_rest(root: Path) -> None:
    put(root, "videos", (MONDAY, {}, listing(video("whole"))), (MONDAY, {}, listing(video("half"))))
    path = rawlog.segments(root, "youtube", "videos")[-1]
    path.write_bytes(path.read_bytes()[:-9])
    with pytest.raises(DamagedData, match=rf"{path.name} is damaged at byte \d+") as caught:
        run_clean(run_at(root), "youtube")
    assert "kb youtube crawl" in caught.value.hint
    assert caught.value.summary == {"source": "youtube", "truncated_files": 1}
    assert not (root / "clean" / "youtube").exists()
    # the tail of an open segment is the crawl's to cut, and nothing to worry about
    path.rename(path.with_name(path.name + ".open"))
    assert run_clean(run_at(root), "youtube")["truncated_files"] == 0


def test_a_line_that_is_no_envelope_names_its_file(root: Path) -> None:
    segment = rawlog.Segment(rawlog.folder(root, "youtube", "videos"))
    segment.append(b'{"no": "envelope"}\n')
    segment.close()
    with pytest.raises(
        DamagedData, match=r"000002-\w+\.ndjson\.zst: a raw line is not an envelope"
    ):
        run_clean(run_at(root), "youtube")
    assert not (root / "clean" / "youtube").exists()


def test_nothing_to_filter_leaves_what_was_there(root: Path) -> None:
    run_clean(run_at(root), "youtube")
    before = digests(root / "clean")
    for path in (root / "raw").rglob("*.zst"):
        path.unlink()
    with pytest.raises(FatalError, match="nothing to filter"):
        run_clean(run_at(root), "youtube")
    assert digests(root / "clean") == before


@pytest.mark.parametrize(
    ("asked", "small", "processes"), [(False, 8 << 20, 0), (True, 8 << 20, 2), (False, 0, 2)]
)
def test_few_bytes_start_no_worker_process_that_nobody_asked_for(
    root: Path, monkeypatch: pytest.MonkeyPatch, asked: bool, small: int, processes: int
) -> None:
    started = []

    class Pool(engine.Processes):
        def __init__(self, workers: int) -> None:
            started.append(workers)
            super().__init__(workers)

    monkeypatch.setattr(engine, "Processes", Pool)
    monkeypatch.setattr(context, "_SMALL", small)
    run = dataclasses.replace(run_at(root, workers=2), asked=asked)
    assert run_clean(run, "youtube")["kept"] > 0
    assert started == [processes] * bool(processes)


def test_videos_that_the_crawl_gave_up_on_are_failed(root: Path) -> None:
    frontier = Frontier(root / "state" / "youtube.sqlite")
    frontier.add_keys("videos", ["kept", "lost", "gone", "waiting"])
    for key in ("kept", "lost", "gone"):
        frontier.error("videos", key, "status_500")
    frontier.close()
    summary = run_clean(run_at(root), "youtube")
    assert (summary["crawled"], summary["failed"]) == (23, 3)
    assert rows(root, "failed")["lost"]["reason"] == "status_500"
    assert set(rows(root, "failed")) == {"lost", "broken", "badcues"}


def test_where_all_rows_are_rejected_the_most_frequent_reason_is_named(tmp_path: Path) -> None:
    with Sandbox(World(n_channels=2, n_videos=6), services=["youtube"]) as sandbox:
        job = Job(sandbox, tmp_path)
        job.done("youtube", "crawl")
        job.profile(("min_views = 100\n", "min_views = 1000000000\n"))
        summary = job.done("youtube", "filter", code=1)
        assert (summary["kept"], summary["pending"]) == (0, 0)
        assert "views: below" in summary["error"]
        assert job.rows("SELECT count(*) AS n FROM clean.youtube_rejected")[0]["n"] > 0


def test_authors_that_were_hashed_with_two_keys_are_refused(root: Path) -> None:
    at = Layout(root)
    for digest in ("a" * 32, "b" * 32):  # raw folders of two machines, copied together
        run_clean(run_at(root), "youtube")
        at.key_mark("youtube", digest).touch()
    with pytest.raises(FatalError, match="with 2 keys") as error:
        run_clean(run_at(root), "youtube")
    assert error.value.exit_code == 1
