"""The graph of a checkpoint is built once, kept, and built again when it is damaged."""

from kb.annotate import onnx_model
from tests.annotate.made import checkpoint_of, make_checkpoint


def test_a_graph_is_kept_and_a_damaged_one_is_not_used(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    checkpoint = checkpoint_of(make_checkpoint(tmp_path / "model"))
    assert onnx_model.find_compiled(checkpoint) is None
    made = onnx_model.make_compiled(checkpoint)
    assert made is not None
    assert onnx_model.find_compiled(checkpoint) == made
    scores = onnx_model.graph_runner(made, threads=1).score(["you are a stupid idiot"])
    assert all(0 <= score <= 1 for score in scores[0])
    graph = made / "model.onnx"
    graph.write_bytes(graph.read_bytes()[:-1])
    assert onnx_model.find_compiled(checkpoint) is None


def test_a_graph_that_differs_from_detoxify_is_thrown_away(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.setattr(onnx_model, "TOLERANCE", -1.0)
    checkpoint = checkpoint_of(make_checkpoint(tmp_path / "model"))
    assert onnx_model.make_compiled(checkpoint) is None
    assert onnx_model.find_compiled(checkpoint) is None
