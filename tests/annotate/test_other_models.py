"""Models of other shapes than `original`: of Detoxify's other architectures, with more outputs than classes."""

from __future__ import annotations

import pytest

from kb.annotate import backends, graph
from kb.annotate.compiled import make_compiled
from kb.annotate.detoxify_model import load_detoxify
from tests.annotate.made import UNBIASED, WORDS, checkpoint_of, make_checkpoint

TEXTS = ["hello there", "you are a stupid idiot", " ".join(WORDS * 3), "creeper", "ünïcode 方块"]


@pytest.fixture(scope="module", params=["roberta", "albert"])
def sixteen(request, tmp_path_factory):
    """A checkpoint as `unbiased` and `unbiased-small`: 16 outputs, of which the first 7 are classes."""
    folder = tmp_path_factory.mktemp(request.param)
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_CACHE_HOME", str(folder / "cache"))
        yield checkpoint_of(make_checkpoint(folder / "model", request.param, UNBIASED, outputs=16))


def test_more_outputs_than_classes_are_read_as_detoxify_reads_them(sixteen):
    detoxify = load_detoxify(sixteen)
    expected = [detoxify.predict(text) for text in TEXTS]
    assert max(row["insult"] for row in expected) - min(row["insult"] for row in expected) > 0.05, "scores that don't differ show nothing"
    runners = [backends.torch_runner(sixteen, "fp32", "cpu", 1)]
    compiled = make_compiled(sixteen)
    assert compiled, "the graph doesn't agree with Detoxify"
    runners += [graph.graph_runner(compiled, 1, prefer=name) for name in ("openvino", "onnxruntime") if graph.installed(name)]
    for runner in runners:
        assert runner.meta.classes == UNBIASED
        for row, theirs in zip(runner.score(TEXTS), expected, strict=True):
            assert row == pytest.approx([theirs[name] for name in UNBIASED], abs=1e-4), runner.name
    if graph.installed("onnxruntime"):
        assert all(len(row) == 7 for row in backends.open_runner(sixteen, "int8").score(TEXTS))
