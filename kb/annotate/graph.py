"""A model's graph by OpenVINO or ONNX Runtime: without torch,
whose import takes longer than scoring a small crawl.
"""

from __future__ import annotations

import importlib.util
import json
import logging
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from kb.annotate.processor import suits_openvino
from kb.annotate.runner import Meta, Network, Runner
from kb.store.atomic import writing

RUNTIMES = ("openvino", "onnxruntime")  # the fastest first
PROBE_ERROR = 1e-3  # of a logit; what works differs by a hundredth of it (kb/annotate/rounding.py)


@dataclass(frozen=True)
class Compiled:
    """A folder with model.onnx, tokenizer.json and meta.json (see `Meta`)."""

    folder: Path

    @property
    def graph(self) -> Path:
        return self.folder / "model.onnx"


def graph_runner(
    compiled: Compiled,
    threads: int,
    prefer: str | None = None,
    exact: Callable[[], Network] | None = None,
) -> Runner | None:
    """The graph in fp32 by OpenVINO or ONNX Runtime; None where neither is installed and works
    here.

    `prefer` names one of them; `exact` is what `Runner` computes undecided windows with.
    """
    meta = Meta.read(compiled.folder / "meta.json")
    for name in (prefer,) if prefer else RUNTIMES:
        network = _working(name, compiled, threads) if usable(name) else None
        if network:
            return Runner(name, network, _tokenizer(compiled), meta, exact=exact)
    return None


def int8_runner(compiled: Compiled, threads: int) -> Runner | None:
    """The graph with 8-bit weights by ONNX Runtime,
    quantized once; None without the package onnx.
    """
    if not installed("onnx"):
        return None
    quantized = compiled.folder / "model.int8.onnx"
    if not quantized.exists():
        from onnxruntime.quantization import QuantType, quantize_dynamic

        with writing(quantized) as fresh:
            root = logging.getLogger()
            before = root.level
            root.setLevel(
                logging.ERROR
            )  # it advises to prepare the graph, which changes nothing for BERT
            try:
                quantize_dynamic(str(compiled.graph), str(fresh), weight_type=QuantType.QInt8)
            finally:
                root.setLevel(before)
    return Runner(
        "onnxruntime",
        _onnxruntime(quantized, threads),
        _tokenizer(compiled),
        Meta.read(compiled.folder / "meta.json"),
    )


def _working(name: str, compiled: Compiled, threads: int) -> Network | None:
    """The network, if it gives on this processor what torch gave when the graph was written."""
    import numpy as np

    make = {"openvino": _openvino, "onnxruntime": _onnxruntime}[name]
    probes = json.loads((compiled.folder / "meta.json").read_text(encoding="utf-8"))["probes"]
    try:
        network = make(compiled.graph, threads)
        for probe in probes:
            logits = np.asarray(network(np.array(probe["ids"]), np.array(probe["mask"])))
            expected = np.array(probe["logits"])
            if logits.shape != expected.shape or np.abs(logits - expected).max() > PROBE_ERROR:
                return None
    except Exception:  # noqa: BLE001 - whatever a library raises that doesn't run here
        return None
    return network


def _tokenizer(compiled: Compiled) -> Any:
    from tokenizers import Tokenizer

    tokenizer = Tokenizer.from_file(str(compiled.folder / "tokenizer.json"))
    tokenizer.no_padding()
    tokenizer.no_truncation()
    return tokenizer


def _onnxruntime(graph: Any, threads: int) -> Network:
    import onnxruntime

    onnxruntime.disable_telemetry_events()  # besides what kb.core.telemetry sets
    onnxruntime.set_default_logger_severity(3)
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads, options.inter_op_num_threads = threads, 1
    session = onnxruntime.InferenceSession(str(graph), options, providers=["CPUExecutionProvider"])
    return lambda ids, mask: session.run(None, {"input_ids": ids, "attention_mask": mask})[0]


def _openvino(graph: Any, threads: int) -> Network:
    import openvino

    # Without the hint OpenVINO takes bf16 on processors that have it.
    hints = {
        "INFERENCE_PRECISION_HINT": "f32",
        "INFERENCE_NUM_THREADS": threads,
        "PERFORMANCE_HINT": "LATENCY",
    }
    model = openvino.Core().compile_model(str(graph), "CPU", hints)
    return lambda ids, mask: model({"input_ids": ids, "attention_mask": mask})[0]


def usable(name: str) -> bool:
    """Whether a runtime is installed and made for this processor, without importing it."""
    return installed(name) and (name != "openvino" or suits_openvino())


def installed(name: str) -> bool:
    """Whether a module can be imported, without importing it."""
    return importlib.util.find_spec(name) is not None
