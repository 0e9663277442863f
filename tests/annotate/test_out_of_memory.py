"""Too little memory is one line with what to do."""

import pytest

from kb.annotate import detoxify_model, worker
from kb.annotate.worker import ScoringJob, score_chunk
from kb.core.errors import FatalError, MissingModel

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

    job = ScoringJob(checkpoint, "bf16", "cpu", 1, None)
    monkeypatch.setattr(detoxify_model, "_read", read)
    worker._runner.cache_clear()
    with pytest.raises(FatalError, match="not enough memory for the toxicity model") as told:
        score_chunk(job, ["a text"])
    assert "--workers" in told.value.hint
    monkeypatch.setattr(detoxify_model, "_read", lambda *arguments: {})
    with pytest.raises(MissingModel):
        score_chunk(job, ["a text"])
