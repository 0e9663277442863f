"""Scores are read, merged and dropped by text, and damage is reported."""

import hashlib
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from hypothesis import given
from hypothesis import strategies as st

from kb.annotate.scores import Scores, text_hashes
from kb.annotate.toxicity import ToxicityScorer
from kb.artifacts import manifest, score_files
from kb.artifacts.purge_rows import drop_annotations
from kb.core.errors import DamagedData

TEXT = st.text(st.characters(exclude_categories=("Cs",)), max_size=60)
TEXTS = ["How to build a house", "you are a stupid idiot", "a", "damn good tutorial", "x " * 300]
HASH = hashlib.sha256(b"a text").hexdigest()


@pytest.fixture
def scores(tmp_path: Path) -> Scores:
    folder = tmp_path / "data" / "annotations" / "youtube"
    folder.mkdir(parents=True)
    made = Scores(str(folder), "original", "0123456789abcdef")
    made.write([HASH], [[0.5]], ["fp32"], ["toxicity"])
    score_files.unite(folder)
    made.write([HASH], [[0.5]], ["fp32"], ["toxicity"])
    return made


@pytest.mark.parametrize("name", ["toxicity.parquet", "part-000000.parquet"])
@pytest.mark.parametrize("how", ["empty", "cut", "other"])
def test_a_damaged_file_of_scores_is_named(scores: Scores, name: str, how: str) -> None:
    path = Path(scores.folder) / name
    data = path.read_bytes()
    path.write_bytes({"empty": b"", "cut": data[:-20], "other": b"no scores" * 20}[how])
    hashes = pa.array([HASH])
    for use in (
        lambda: scores.lookup(hashes),
        scores.precisions,
        lambda: score_files.unite(path.parent),
    ):
        with pytest.raises(DamagedData, match=f"{path} can't be read") as error:
            use()
        assert "remove it, then run `kb youtube filter`" in error.value.hint
    path.unlink()
    assert scores.lookup(hashes)["precision"].to_pylist() == ["fp32"]


@given(st.lists(st.none() | TEXT, max_size=8))
def test_hashes_are_sha256_of_utf8_and_null_for_nothing(texts):
    expected = [hashlib.sha256(text.encode()).hexdigest() if text else None for text in texts]
    assert text_hashes(pa.array(texts, pa.string())).to_pylist() == expected


def test_scores_are_read_and_merged(make_run):
    run = make_run()
    ToxicityScorer.open(run, "reddit").annotate([TEXTS[:3]])
    path = run.root / "annotations/reddit/toxicity.parquet"
    counts = ToxicityScorer.open(run, "reddit").annotate([TEXTS])
    assert (counts.scored, counts.known) == (len(TEXTS) - 3, 3)
    assert pq.read_table(path).num_rows == len(TEXTS)
    with manifest.editing(run.root, "annotations/reddit"):
        dropped = drop_annotations(run.root, "reddit", text_hashes(pa.array(TEXTS[:2])))
    assert dropped == len(TEXTS) - 2
    assert ToxicityScorer.open(run, "reddit").annotate([TEXTS[:2]]).scored == 0
