"""Tests of `kb.store.rawlog.recorder`."""

import random
import signal
import time
from pathlib import Path

from kb.store.rawlog import rawlog
from kb.store.rawlog.recorder import Recorder
from tests import processes
from tests.store.state.test_frontier import open_frontier


def apply(frontier, kind, envelope):
    key = envelope.request.params["id"]
    frontier.add_keys("video", [key])
    frontier.done("video", key)


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


PROGRAM = """
import sys
from pathlib import Path
sys.path.insert(0, sys.argv[2])
from tests.store.rawlog.test_recorder import apply, open_frontier
from kb.store.rawlog.recorder import Recorder
root = Path(sys.argv[1])
frontier = open_frontier(root)
frontier.add_keys("video", [f"v{n}" for n in range(1000)])
with Recorder(root, "youtube", frontier, apply) as recorder:
    print("go", flush=True)
    while items := frontier.take("video"):
        frontier.spend("general", 1, "videos")
        recorder.record("videos", "videos", {"id": items[0].key}, 200, {"x": "y" * 500})
"""


def test_sigkill_at_random_moments_loses_and_doubles_nothing(tmp_path):
    rng = random.Random(7)
    for turn in range(6):
        child = processes.program(PROGRAM, tmp_path, Path(__file__).parents[3])
        while child.poll() is None and not child.output()[0]:
            time.sleep(0.002)
        if turn < 5:
            time.sleep(rng.uniform(0, 0.15))
            child.send_signal(signal.SIGKILL)
        assert child.wait() in (0, -signal.SIGKILL), child.output()
    frontier = open_frontier(tmp_path)
    assert frontier.counts("video") == {"done": 1000}
    asked = [
        envelope.request.params["id"]
        for envelope in rawlog.envelopes(tmp_path, "youtube", "videos")
    ]
    # An answer whose frame is whole is never asked for again; one that was in flight at a kill may
    # be twice in the ledger.
    assert sorted(asked) == sorted(f"v{n}" for n in range(1000))
    assert 1000 <= frontier.requests()[0] <= 1000 + 5
