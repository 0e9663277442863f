"""Frontier, ledger and recorder: nothing answered is asked again, nothing asked is forgotten."""

from __future__ import annotations

import contextlib
import os
import random
import shutil
import signal
import sqlite3
import time
from pathlib import Path

import pytest

from kb.core.errors import DamagedData, OtherService, WriterLocked
from kb.store import lock
from kb.store.rawlog import rawlog
from kb.store.rawlog.recorder import Recorder
from kb.store.state import frontier as module
from kb.store.state import identity
from kb.store.state.frontier import Frontier
from tests import processes


def apply(frontier, kind, envelope):
    key = envelope.request.params["id"]
    frontier.add("video", [key])
    frontier.done("video", key)


def open_frontier(root):
    return Frontier(root / "state" / "youtube.sqlite")


def test_items_are_taken_in_the_order_of_adding_and_once(tmp_path):
    frontier = open_frontier(tmp_path)
    assert frontier.add("video", ["c", "a", ("b", {"channel": 1})]) == 3
    assert frontier.add("video", ["a", "d"]) == 1
    assert [item.key for item in frontier.take("video", 2)] == ["c", "a"]
    assert [(item.key, item.payload) for item in frontier.take("video", 9)] == [
        ("b", {"channel": 1}),
        ("d", None),
    ]
    assert frontier.take("video") == []


def test_what_was_in_flight_is_asked_again_and_an_error_only_on_request(tmp_path):
    frontier = open_frontier(tmp_path)
    frontier.add("video", ["a", "b", "c"])
    frontier.take("video", 3)
    frontier.done("video", "a")
    frontier.error("video", "b", "HTTP 500")
    frontier.close()
    frontier = open_frontier(tmp_path)
    assert frontier.counts("video") == {"done": 1, "error": 1, "todo": 1}
    assert frontier.reopen("video", "error") == 1
    assert {item.key for item in frontier.take("video", 9)} == {"b", "c"}


def test_a_failed_transaction_changes_nothing(tmp_path):
    frontier = open_frontier(tmp_path)
    with pytest.raises(RuntimeError), frontier.transaction():
        frontier.add("video", ["a"])
        frontier.set_cursor("page", "x")
        raise RuntimeError
    assert (frontier.counts("video"), frontier.cursor("page")) == ({}, None)


def test_the_ledger_is_committed_before_anything_else(tmp_path):
    frontier = open_frontier(tmp_path)
    row = frontier.spend("general", 1, "videos.list", "2026-11-20")
    other = sqlite3.connect(tmp_path / "state" / "youtube.sqlite")
    assert other.execute("SELECT bucket, units, outcome FROM ledger").fetchall() == [
        ("general", 1, None)
    ]
    frontier.outcome(row, "200")
    assert frontier.spent("general", "2026-11-20") == 1


def counted(frontier, kind, envelope):
    """Takes an answer in, and counts how often that happened."""
    apply(frontier, kind, envelope)
    frontier.set_cursor("applied", frontier.cursor("applied", 0) + 1)


def test_a_lost_state_is_rebuilt_from_raw(tmp_path):
    frontier = open_frontier(tmp_path)
    with Recorder(tmp_path, "youtube", frontier, apply) as recorder:
        for number in range(20):
            recorder.record("videos", "videos", {"id": f"v{number}"}, 200, {})
    frontier.close()
    for path in (tmp_path / "state").glob("youtube.sqlite*"):
        path.unlink()
    frontier = open_frontier(tmp_path)
    Recorder(tmp_path, "youtube", frontier, counted)
    assert frontier.counts("video") == {"done": 20}
    assert frontier.cursor("applied") == 20
    Recorder(tmp_path, "youtube", frontier, counted)
    assert frontier.cursor("applied") == 20


@pytest.mark.parametrize("how", ["another", "not an envelope", "cut"])
def test_a_damaged_segment_that_the_state_does_not_know_is_set_aside(tmp_path, how):
    """It is read once; what came before the damage is not taken in twice."""
    frontier = open_frontier(tmp_path)
    with Recorder(tmp_path, "youtube", frontier, apply) as recorder:
        for number in range(5):
            recorder.record("videos", "videos", {"id": f"v{number}"}, 200, {})
    frontier.close()
    shutil.rmtree(tmp_path / "state")
    [path] = rawlog.segments(tmp_path, "youtube", "videos")
    frames = rawlog.Frames(path)
    places = [(frames.start, end) for end, _ in frames]
    start, end = places[-1] if how == "cut" else places[2]
    odd = rawlog.compressor().compress(b"a note\n") if how == "not an envelope" else b"\xff" * 9
    whole = path.read_bytes()
    path.write_bytes(whole[:start] + odd + (b"" if how == "cut" else whole[end:]))

    frontier = open_frontier(tmp_path)
    with pytest.raises(DamagedData, match=f"{len(odd)} bytes at {start}") as said:
        Recorder(tmp_path, "youtube", frontier, counted)
    aside = path.with_name(f"{path.name}.damaged-{start}")
    assert aside.name in str(said.value)
    assert aside.read_bytes() == odd
    assert (frontier.counts("video"), frontier.cursor("applied")) == ({"done": 4}, 4)
    assert frontier.offset("videos", rawlog.base_name(path)) == path.stat().st_size
    Recorder(tmp_path, "youtube", frontier, counted)
    assert frontier.cursor("applied") == 4


PROGRAM = """
import sys
from pathlib import Path
sys.path.insert(0, sys.argv[2])
from test_frontier import apply, open_frontier
from kb.store.rawlog.recorder import Recorder
root = Path(sys.argv[1])
frontier = open_frontier(root)
frontier.add("video", [f"v{n}" for n in range(400)])
with Recorder(root, "youtube", frontier, apply) as recorder:
    print("go", flush=True)
    while items := frontier.take("video"):
        frontier.spend("general", 1, "videos")
        recorder.record("videos", "videos", {"id": items[0].key}, 200, {"x": "y" * 500})
"""


def test_sigkill_at_random_moments_loses_and_doubles_nothing(tmp_path):
    rng = random.Random(7)
    for turn in range(12):
        child = processes.program(PROGRAM, tmp_path, Path(__file__).parent)
        while child.poll() is None and not child.output()[0]:
            time.sleep(0.002)
        if turn < 11:
            time.sleep(rng.uniform(0, 0.15))
            child.send_signal(signal.SIGKILL)
        assert child.wait() in (0, -signal.SIGKILL), child.output()
    frontier = open_frontier(tmp_path)
    assert frontier.counts("video") == {"done": 400}
    asked = [
        envelope.request.params["id"] for envelope in rawlog.read(tmp_path, "youtube", "videos")
    ]
    # An answer whose frame is whole is never asked for again; one that was in flight at a kill may
    # be twice in the ledger.
    assert sorted(asked) == sorted(f"v{n}" for n in range(400))
    assert 400 <= frontier.requests()[0] <= 400 + 11


def plan_of(frontier, sql, *values):
    return " ".join(row[3] for row in frontier._db.execute(f"EXPLAIN QUERY PLAN {sql}", values))


def test_adding_a_key_reads_no_other_item(tmp_path):
    frontier = open_frontier(tmp_path)
    frontier.add("video", ["c", "a", "b"])
    frontier.done("video", "b")
    # One step into the index, however many items there are, and no sorting afterwards.
    assert plan_of(frontier, module.LAST, "video") == (
        "SEARCH items USING COVERING INDEX items_by_order (kind=?)"
    )
    taking = "SELECT key FROM items WHERE kind = ? AND status = 'todo' ORDER BY seq LIMIT 1"
    assert "items_by_status (kind=? AND status=?)" in plan_of(frontier, taking, "video")
    assert "B-TREE" not in plan_of(frontier, taking, "video")
    assert frontier.add("video", ["d"]) == 1
    assert [key for key, *_ in frontier.items("video")] == ["c", "a", "b", "d"]


def as_version_1(root):
    """The state as the first version left it, killed before its log was folded in."""
    frontier = open_frontier(root)
    frontier._db.execute("DROP INDEX items_by_order")
    frontier._db.execute("PRAGMA user_version = 1")
    frontier.add("video", ["c", ("a", {"channel": 1}), "b"])
    frontier.done("video", "c")
    state = root / "killed" / "state"
    state.mkdir(parents=True)
    for name in ("youtube.sqlite", "youtube.sqlite-wal"):
        shutil.copyfile(frontier.path.with_name(name), state / name)
    frontier.close()
    return root / "killed"


def test_an_older_state_is_migrated_after_a_backup(tmp_path):
    root = as_version_1(tmp_path)
    frontier = open_frontier(root)
    assert frontier._db.execute("PRAGMA user_version").fetchone() == (2,)
    assert "items_by_order" in plan_of(frontier, module.LAST, "video")
    assert [item.key for item in frontier.take("video", 9)] == ["a", "b"]
    # The backup is whole: also what was in the log only.
    backup = root / "state" / "youtube.sqlite.v1.bak"
    with contextlib.closing(sqlite3.connect(backup)) as old:
        assert old.execute("PRAGMA user_version").fetchone() == (1,)
        assert old.execute("SELECT key, status FROM items ORDER BY seq").fetchall() == [
            ("c", "done"),
            ("a", "todo"),
            ("b", "todo"),
        ]
    frontier.close()
    assert sorted(path.name for path in backup.parent.iterdir()) == [
        "youtube.sqlite",
        "youtube.sqlite.v1.bak",
    ]
    before = backup.stat().st_mtime_ns
    open_frontier(root).close()
    assert backup.stat().st_mtime_ns == before


def test_a_state_of_a_newer_version_is_left_alone(tmp_path):
    frontier = open_frontier(tmp_path)
    frontier._db.execute("PRAGMA user_version = 99")
    frontier.close()
    with pytest.raises(DamagedData, match="newer Lorecrawl"):
        open_frontier(tmp_path)


def test_what_was_removed_is_in_no_byte_of_any_file(tmp_path):
    frontier = open_frontier(tmp_path)
    keys = [f"key{number:05d}" for number in range(5_000)]
    frontier.add("video", [(key, {"channel": key}) for key in keys])
    frontier.done("video", *keys[::3])
    gone = keys[7::50]
    frontier.remove("video", gone)
    (tmp_path / "state" / "youtube.sqlite.v1.bak").write_text(gone[0])
    frontier.forget()
    found = b"".join(path.read_bytes() for path in (tmp_path / "state").iterdir())
    assert not [key for key in gone if key.encode() in found]
    assert sum(frontier.counts("video").values()) == len(keys) - len(gone)
    assert all(key.encode() in found for key in keys if key not in gone)


def test_replace_leaves_only_the_new_ones_in_their_order(tmp_path):
    frontier = open_frontier(tmp_path)
    frontier.add("info", ["a", "b", "c"])
    frontier.done("info", "b")
    frontier.add("video", ["a"])
    assert frontier.replace("info", iter(["z", ("b", {"post": "p"})])) == 2
    assert [(item.key, item.payload) for item in frontier.take("info", 9)] == [
        ("z", None),
        ("b", {"post": "p"}),
    ]
    assert frontier.counts("video") == {"todo": 1}


def test_a_state_that_cannot_be_read_says_what_to_do(tmp_path):
    (tmp_path / "state").mkdir()
    (tmp_path / "state" / "youtube.sqlite").write_bytes(b"no database " * 999)
    with pytest.raises(DamagedData) as error:
        open_frontier(tmp_path)
    assert "rebuilds it from the raw data" in error.value.hint


def test_a_second_writer_names_the_first(tmp_path):
    with lock.writer(tmp_path, "youtube"):
        with pytest.raises(WriterLocked, match=str(os.getpid())), lock.writer(tmp_path, "youtube"):
            pass
        with lock.writer(tmp_path, "reddit"):
            pass
    with lock.writer(tmp_path, "youtube"):
        pass


def test_a_root_keeps_to_its_services(tmp_path):
    identity.remember(tmp_path, "reddit", host="http://127.0.0.1:5000", subreddit="minecraft")
    identity.remember(tmp_path, "reddit", host="http://127.0.0.1:6000", subreddit="minecraft")
    # What was noted binds from the first answer on (tests/store/test_identity.py).
    segment = rawlog.Segment(rawlog.folder(tmp_path, "reddit", "listings"))
    segment.append(
        rawlog.encode(rawlog.Envelope("2026-11-20T12:00:00Z", rawlog.Request("new", {}), 200, {}))
    )
    segment.close()
    with pytest.raises(OtherService, match="subreddit minecraft, not terraria"):
        identity.remember(tmp_path, "reddit", subreddit="terraria")
    with pytest.raises(OtherService, match=r"127\.0\.0\.1, not oauth\.reddit\.com"):
        identity.remember(tmp_path, "reddit", host="https://oauth.reddit.com")
