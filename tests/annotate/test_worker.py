"""A worker finishes a short chunk when it is asked to stop."""

import pytest

from kb.annotate import worker
from kb.core import signals
from kb.core.errors import Interrupted


def test_a_stop_waits_for_a_chunk_of_seconds_not_for_one_of_minutes(checkpoint, monkeypatch):
    job = worker.ScoringJob(checkpoint, "fp32", "cpu", 1, None)
    texts = ["hello there", "x " * 2000]
    try:
        signals.stop.request("SIGTERM")
        assert len(worker.score_chunk(job, texts)["scores"]) == 2
        monkeypatch.setattr(worker, "HAND_S", -1.0)
        with pytest.raises(Interrupted):
            worker.score_chunk(job, texts)
    finally:
        signals.stop.clear()
