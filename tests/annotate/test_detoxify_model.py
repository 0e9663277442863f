"""Models of other shapes than `original`: of Detoxify's other architectures,
with more outputs than classes.
"""

import pyarrow as pa
import pytest
from hypothesis import given
from hypothesis import strategies as st

from kb.annotate import backends
from kb.annotate.detoxify_model import load_detoxify
from kb.annotate.inference import batches, largest, padded_length, windows
from kb.annotate.scores import CATEGORIES, text_hashes
from kb.annotate.toxicity import ToxicityScorer
from kb.core.errors import MissingModel
from tests.annotate.made import WORDS, checkpoint_of, make_checkpoint
from tests.conftest import needs

UNBIASED = (
    "toxicity",
    "severe_toxicity",
    "obscene",
    "identity_attack",
    "insult",
    "threat",
    "sexual_explicit",
)


needs("torch", "detoxify")

BACKENDS = (backends.open_runner, backends.torch_runner)
TEXTS = ["hello there", "you are a stupid idiot", " ".join(WORDS * 3), "creeper", "ünïcode 方块"]


@pytest.fixture(scope="module", params=["roberta", "albert"])
def sixteen(request, tmp_path_factory):
    """A checkpoint as `unbiased` and `unbiased-small`: 16 outputs,
    of which the first 7 are classes.
    """
    folder = tmp_path_factory.mktemp(request.param)
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_CACHE_HOME", str(folder / "cache"))
        yield checkpoint_of(make_checkpoint(folder / "model", request.param, UNBIASED, outputs=16))


def test_more_outputs_than_classes_are_read_as_detoxify_reads_them(sixteen):
    detoxify = load_detoxify(sixteen)
    expected = [detoxify.predict(text) for text in TEXTS]
    assert max(row["insult"] for row in expected) - min(row["insult"] for row in expected) > 0.05, (
        "scores that don't differ show nothing"
    )
    runners = [make(sixteen, "fp32", "cpu", 1) for make in BACKENDS]
    assert [runner.name for runner in runners] == ["onnxruntime", "torch"]
    for runner in runners:
        assert runner.meta.classes == UNBIASED
        for row, theirs in zip(runner.score(TEXTS), expected, strict=True):
            assert row == pytest.approx([theirs[name] for name in UNBIASED], abs=1e-4), runner.name
    assert all(len(row) == 7 for row in backends.open_runner(sixteen, "int8").score(TEXTS))


def test_a_class_that_only_some_models_have_is_kept_and_counts(sixteen, make_run):
    run = make_run(model=str(sixteen.path))
    scorer = ToxicityScorer.open(run, "reddit")
    scorer.annotate([TEXTS])
    scores = scorer.lookup(text_hashes(pa.array(TEXTS)))
    detoxify = load_detoxify(sixteen)
    for n, text in enumerate(TEXTS):
        theirs = detoxify.predict(text)
        assert scores["sexual_explicit"][n].as_py() == pytest.approx(
            theirs["sexual_explicit"], abs=1e-4
        )


def test_a_class_that_the_model_lacks_is_null_and_one_without_toxicity_is_exit_2(
    make_run, tmp_path, monkeypatch
):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    run = make_run(
        model=str(make_checkpoint(tmp_path / "two", classes=("toxic", "spam"), outputs=2))
    )
    ToxicityScorer.open(run, "wiki").annotate([TEXTS])
    found = ToxicityScorer.open(run, "wiki").lookup(text_hashes(pa.array(TEXTS)))
    assert found["toxicity"].null_count == 0
    assert all(found[name].null_count == len(TEXTS) for name in CATEGORIES[1:])
    foreign = make_run(
        model=str(make_checkpoint(tmp_path / "foreign", classes=("spam", "ham"), outputs=2))
    )
    with pytest.raises(MissingModel, match="no class 'toxicity'") as error:
        ToxicityScorer.open(foreign, "youtube").annotate([TEXTS])
    assert error.value.exit_code == 2
    assert not (run.root / "annotations/youtube").exists()


@given(st.integers(0, 2000), st.integers(3, 600))
def test_windows_hold_every_token_once_and_fit(length, size):
    ids = list(range(length))
    found = windows(ids, size)
    assert [token for window in found for token in window] == ids
    assert all(len(window) <= size - 2 for window in found)
    assert len(found) == max(1, -(-length // (size - 2)))


def test_the_largest_of_a_texts_windows_counts():
    assert largest([[0.1, 0.9], [0.5, 0.2], [0.3, 0.3]], [0, 0, 1], 2) == [[0.5, 0.9], [0.3, 0.3]]
    with pytest.raises(ValueError, match="no window"):
        largest([[0.1]], [0], 2)


@given(st.lists(st.integers(1, 512), max_size=200), st.integers(64, 4096))
def test_batches_hold_each_window_once_within_the_budget(lengths, budget):
    seen: list[int] = []
    widths = []
    for width, numbers in batches(lengths, budget):
        seen += numbers
        widths.append(width)
        assert all(padded_length(lengths[number]) == width >= lengths[number] for number in numbers)
        assert len(numbers) == 1 or width * len(numbers) <= budget
    assert sorted(seen) == list(range(len(lengths)))
    assert widths == sorted(widths)
    assert list(batches(lengths, budget)) == list(batches(lengths, budget))


def test_a_graph_is_kept_and_a_damaged_one_is_not_used(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    checkpoint = checkpoint_of(make_checkpoint(tmp_path / "model"))
    assert backends.find_compiled(checkpoint) is None
    made = backends.make_compiled(checkpoint)
    assert made is not None
    assert backends.find_compiled(checkpoint) == made
    scores = backends.graph_runner(made, threads=1).score(["you are a stupid idiot"])
    assert all(0 <= score <= 1 for score in scores[0])
    graph = made / "model.onnx"
    graph.write_bytes(graph.read_bytes()[:-1])
    assert backends.find_compiled(checkpoint) is None


def test_a_graph_that_differs_from_detoxify_is_thrown_away(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.setattr(backends, "TOLERANCE", -1.0)
    checkpoint = checkpoint_of(make_checkpoint(tmp_path / "model"))
    assert backends.make_compiled(checkpoint) is None
    assert backends.find_compiled(checkpoint) is None
