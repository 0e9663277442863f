"""A model's graph by ONNX Runtime: without torch, whose import takes longer than scoring a small
crawl.
"""

from __future__ import annotations

import logging
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from kb.annotate.runner import Meta, ModelNetwork, Runner
from kb.store.atomic import writing


@dataclass(frozen=True)
class Compiled:
    """A folder with model.onnx, tokenizer.json and meta.json (see `Meta`)."""

    folder: Path

    @property
    def graph(self) -> Path:
        return self.folder / "model.onnx"


def graph_runner(
    compiled: Compiled, threads: int, exact: Callable[[], ModelNetwork] | None = None
) -> Runner:
    """The graph in fp32; `exact` is what `Runner` computes undecided windows with."""
    return _runner(compiled, compiled.graph, threads, exact)


def int8_runner(compiled: Compiled, threads: int) -> Runner:
    """The graph with 8-bit weights, quantized once."""
    quantized = compiled.folder / "model.int8.onnx"
    if not quantized.exists():
        from onnxruntime.quantization import QuantType, quantize_dynamic

        with writing(quantized) as fresh:
            root = logging.getLogger()
            before = root.level
            # It advises to prepare the graph, which changes nothing for BERT.
            root.setLevel(logging.ERROR)
            try:
                quantize_dynamic(str(compiled.graph), str(fresh), weight_type=QuantType.QInt8)
            finally:
                root.setLevel(before)
    return _runner(compiled, quantized, threads)


def _runner(
    compiled: Compiled, graph: Path, threads: int, exact: Callable[[], ModelNetwork] | None = None
) -> Runner:
    import onnxruntime
    from tokenizers import Tokenizer

    onnxruntime.disable_telemetry_events()  # besides what kb.core.telemetry sets
    onnxruntime.set_default_logger_severity(3)
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads, options.inter_op_num_threads = threads, 1
    session = onnxruntime.InferenceSession(str(graph), options, providers=["CPUExecutionProvider"])

    def network(ids: Any, mask: Any) -> Any:
        return session.run(None, {"input_ids": ids, "attention_mask": mask})[0]

    tokenizer = Tokenizer.from_file(str(compiled.folder / "tokenizer.json"))
    tokenizer.no_padding()
    tokenizer.no_truncation()
    meta = Meta.read(compiled.folder / "meta.json")
    return Runner("onnxruntime", network, tokenizer, meta, exact=exact)
