"""Damaged scores and too little memory: one line with what to do."""

from __future__ import annotations

import hashlib
from pathlib import Path

import pyarrow as pa
import pytest

from kb.annotate import detoxify_model, worker
from kb.annotate.scores import Scores
from kb.annotate.worker import ScoringJob, score_chunk
from kb.core.errors import DamagedData, FatalError, MissingModel

HASH = hashlib.sha256(b"a text").hexdigest()


@pytest.fixture
def scores(tmp_path: Path) -> Scores:
    folder = tmp_path / "data" / "annotations" / "youtube"
    folder.mkdir(parents=True)
    made = Scores(str(folder), "original", "0123456789abcdef")
    made.write([HASH], [[0.5]], ["fp32"], ["toxicity"])
    made.merge()
    made.write([HASH], [[0.5]], ["fp32"], ["toxicity"])
    return made


@pytest.mark.parametrize("name", ["toxicity.parquet", "part-000000.parquet"])
@pytest.mark.parametrize("how", ["empty", "cut", "other"])
def test_a_damaged_file_of_scores_is_named(scores: Scores, name: str, how: str) -> None:
    path = Path(scores.folder) / name
    data = path.read_bytes()
    path.write_bytes({"empty": b"", "cut": data[:-20], "other": b"no scores" * 20}[how])
    hashes = pa.array([HASH])
    for use in (lambda: scores.lookup(hashes), scores.precisions, scores.merge):
        with pytest.raises(DamagedData, match=f"{path} can't be read") as error:
            use()
        assert "remove it, then run `kb youtube filter`" in error.value.hint
    path.unlink()
    assert scores.lookup(hashes)["precision"].to_pylist() == ["fp32"]


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
