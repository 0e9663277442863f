"""A worker finishes a short chunk before it stops, and reports a lack of memory in one line."""

import pytest

from kb.annotate import detoxify_model, toxicity
from kb.core import signals
from kb.core.errors import FatalError, Interrupted, MissingModel


def test_a_stop_waits_for_a_chunk_of_seconds_not_for_one_of_minutes(checkpoint, monkeypatch):
    job = toxicity.ScoringJob(checkpoint, "fp32", "cpu", 1, None)
    texts = ["hello there", "x " * 2000]
    try:
        signals.stop.request("SIGTERM")
        assert len(toxicity.score_chunk(job, texts)["scores"]) == 2
        monkeypatch.setattr(toxicity, "HAND_S", -1.0)
        with pytest.raises(Interrupted):
            toxicity.score_chunk(job, texts)
    finally:
        signals.stop.clear()


SAID = [
    MemoryError(),
    RuntimeError("[enforce fail] DefaultCPUAllocator: can't allocate memory: you tried to …"),
    RuntimeError("std::bad_alloc"),
]


@pytest.mark.parametrize("error", SAID, ids=["Python", "torch", "ONNX Runtime"])
def test_too_little_memory_is_no_wrong_model(
    checkpoint, monkeypatch: pytest.MonkeyPatch, error: Exception
) -> None:
    def read(*arguments: object) -> None:
        raise error

    job = toxicity.ScoringJob(checkpoint, "bf16", "cpu", 1, None)
    monkeypatch.setattr(detoxify_model, "_read", read)
    toxicity._runner.cache_clear()
    with pytest.raises(FatalError, match="not enough memory for the toxicity model") as told:
        toxicity.score_chunk(job, ["a text"])
    assert "--workers" in told.value.hint
    monkeypatch.setattr(detoxify_model, "_read", lambda *arguments: {})
    with pytest.raises(MissingModel):
        toxicity.score_chunk(job, ["a text"])
