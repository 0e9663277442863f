"""What runs the model: OpenVINO or ONNX Runtime on the graph, or torch. In fp32 all give the same scores.

A runner turns texts into scores: tokens, windows, batches, one pass a batch, the largest window.
Scores are rounded to five decimals: far below what they mean, and far above the last bits in which
machines and backends differ.
"""

from __future__ import annotations

import importlib.util
import os
from collections.abc import Sequence
from typing import Any, Protocol

from kb.annotate.batches import TOKEN_BUDGET, batches
from kb.annotate.checkpoint import Checkpoint
from kb.annotate.compiled import Compiled, Meta, can_compile, find_compiled, make_compiled
from kb.annotate.first_token import shorten
from kb.annotate.windows import largest, windows
from kb.core.errors import MissingExtra, SettingError

PRECISIONS = ("fp32", "bf16", "int8")
# Within this of a threshold a reduced score may fall on the other side; half of it was measured, on random weights.
REACH = {"fp32": 0.0, "bf16": 0.04, "int8": 0.15}
DECIMALS = 5


class Network(Protocol):
    """One pass: two int64 arrays of the same shape (windows, tokens) give logits (windows, classes)."""

    def __call__(self, ids: Any, mask: Any) -> Any: ...


class Runner:
    """Scores texts with one network. Not for several threads at once."""

    def __init__(self, name: str, network: Network, tokenizer: Any, meta: Meta, budget: int = TOKEN_BUDGET) -> None:
        self.name, self.meta, self.budget = name, meta, budget
        self.tokens = 0  # scored so far, padding left out
        self._network, self._tokenizer = network, tokenizer

    def score(self, texts: Sequence[str]) -> list[list[float]]:
        """One row of scores a text, in the order of `meta.classes`; each between 0 and 1."""
        import numpy as np

        if not texts:
            return []
        found: list[Sequence[int]] = []
        owners: list[int] = []
        marks = len(self.meta.prefix) + len(self.meta.suffix)
        for number, encoded in enumerate(self._tokenizer.encode_batch(list(texts), add_special_tokens=False)):
            for window in windows(encoded.ids, self.meta.window, marks):
                found.append([*self.meta.prefix, *window, *self.meta.suffix])
                owners.append(number)
        scores = np.empty((len(found), len(self.meta.classes)))
        for width, numbers in batches([len(window) for window in found], self.budget, self.meta.window):
            ids = np.full((len(numbers), width), self.meta.pad, dtype=np.int64)
            mask = np.zeros((len(numbers), width), dtype=np.int64)
            for row, number in enumerate(numbers):
                window = found[number]
                ids[row, : len(window)] = window
                mask[row, : len(window)] = 1
            logits = np.asarray(self._network(ids, mask), dtype=np.float64)
            scores[numbers] = 1.0 / (1.0 + np.exp(-logits))
            self.tokens += int(mask.sum())
        return largest(np.round(scores, DECIMALS).tolist(), owners, len(texts))


def open_runner(checkpoint: Checkpoint, precision: str = "fp32", device: str = "cpu", threads: int = 1) -> Runner:
    """The fastest runner that is installed for this precision and device.

    Raises MissingExtra, MissingModel, SettingError (no such device or precision).
    """
    if precision not in PRECISIONS:
        raise SettingError(f"--precision is {precision!r}", hint=f"allowed: {', '.join(PRECISIONS)}")
    os.environ.setdefault("RAYON_NUM_THREADS", str(threads))  # the tokenizer's own threads
    if device == "cuda":
        if precision == "int8":
            raise SettingError("--precision int8 runs on a CPU only", hint="use bf16 on a GPU")
        return _torch_runner(checkpoint, precision, device, threads)
    if precision == "bf16":
        return _torch_runner(checkpoint, precision, device, threads)
    wanted = ("onnxruntime",) if precision == "int8" else ("openvino", "onnxruntime")
    if any(_installed(name) for name in wanted):
        compiled = prepare(checkpoint)
        if compiled:
            runner = _int8_runner(compiled, threads) if precision == "int8" else graph_runner(compiled, threads)
            if runner:
                return runner
    if precision == "int8":
        raise MissingExtra("--precision int8 needs onnxruntime and onnx", hint="run `pip install onnxruntime onnx`")
    return _torch_runner(checkpoint, precision, device, threads)


def prepare(checkpoint: Checkpoint) -> Compiled | None:
    """The graph of the checkpoint, made now when there is none; None when it can't be made."""
    return find_compiled(checkpoint) or (make_compiled(checkpoint) if can_compile() else None)


def graph_runner(compiled: Compiled, threads: int, prefer: str | None = None) -> Runner | None:
    """The graph in fp32 by OpenVINO or ONNX Runtime (`prefer` names one); None when neither is installed."""
    meta = Meta.read(compiled.folder / "meta.json")
    for name in (prefer,) if prefer else ("openvino", "onnxruntime"):
        if _installed(name):
            network = (
                _openvino(compiled.graph, threads) if name == "openvino" else _onnxruntime(compiled.graph, threads)
            )
            return Runner(name, network, _tokenizer(compiled), meta)
    return None


def torch_network(model: Any, device: str, precision: str) -> Network:
    """A transformers model in torch as a network."""
    import torch

    def network(ids: Any, mask: Any) -> Any:
        with torch.inference_mode():
            logits = model(
                input_ids=torch.from_numpy(ids).to(device), attention_mask=torch.from_numpy(mask).to(device)
            )[0]
        return logits.float().cpu().numpy()

    model.eval()
    if precision == "bf16":
        model.to(torch.bfloat16)
    return network


def choose_device(wanted: str) -> str:
    """ "cpu" or "cuda" for `--device auto|cpu|cuda`. Raises SettingError when there is no GPU to use."""
    import shutil

    if wanted not in ("auto", "cpu", "cuda"):
        raise SettingError(f"--device is {wanted!r}", hint="allowed: auto, cpu, cuda")
    if wanted == "cpu":
        return "cpu"
    # Importing torch takes seconds; without a driver there is nothing to ask it.
    if os.path.exists("/proc/driver/nvidia/version") or shutil.which("nvidia-smi"):
        import torch

        if torch.cuda.is_available():
            return "cuda"
    if wanted == "cuda":
        raise SettingError(
            "--device cuda: torch sees no GPU here", hint="use --device auto, or install a CUDA build of torch"
        )
    return "cpu"


def _torch_runner(checkpoint: Checkpoint, precision: str, device: str, threads: int) -> Runner:
    from kb.annotate.detoxify_model import load_detoxify

    detoxify = load_detoxify(checkpoint, device)
    if device == "cpu":
        import torch

        torch.set_num_threads(threads)
    shorten(detoxify.model)
    meta = Meta.of(detoxify)
    tokenizer = detoxify.tokenizer.backend_tokenizer
    tokenizer.no_padding()
    tokenizer.no_truncation()
    budget = TOKEN_BUDGET if device == "cpu" else 32 * TOKEN_BUDGET
    return Runner("torch", torch_network(detoxify.model, device, precision), tokenizer, meta, budget)


def _tokenizer(compiled: Compiled) -> Any:
    from tokenizers import Tokenizer

    tokenizer = Tokenizer.from_file(str(compiled.folder / "tokenizer.json"))
    tokenizer.no_padding()
    tokenizer.no_truncation()
    return tokenizer


def _onnxruntime(graph: Any, threads: int) -> Network:
    import onnxruntime

    onnxruntime.set_default_logger_severity(3)
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads, options.inter_op_num_threads = threads, 1
    session = onnxruntime.InferenceSession(str(graph), options, providers=["CPUExecutionProvider"])
    return lambda ids, mask: session.run(None, {"input_ids": ids, "attention_mask": mask})[0]


def _openvino(graph: Any, threads: int) -> Network:
    import openvino

    # Without the hint OpenVINO takes bf16 on processors that have it.
    hints = {"INFERENCE_PRECISION_HINT": "f32", "INFERENCE_NUM_THREADS": threads, "PERFORMANCE_HINT": "LATENCY"}
    model = openvino.Core().compile_model(str(graph), "CPU", hints)
    return lambda ids, mask: model({"input_ids": ids, "attention_mask": mask})[0]


def _int8_runner(compiled: Compiled, threads: int) -> Runner | None:
    if not _installed("onnx"):
        return None
    quantized = compiled.folder / "model.int8.onnx"
    if not quantized.exists():
        import logging

        from onnxruntime.quantization import QuantType, quantize_dynamic

        from kb.store.atomic import writing

        with writing(quantized) as fresh:
            root = logging.getLogger()
            before = root.level
            root.setLevel(logging.ERROR)  # it advises to prepare the graph, which changes nothing for BERT
            try:
                quantize_dynamic(str(compiled.graph), str(fresh), weight_type=QuantType.QInt8)
            finally:
                root.setLevel(before)
    return Runner(
        "onnxruntime", _onnxruntime(quantized, threads), _tokenizer(compiled), Meta.read(compiled.folder / "meta.json")
    )


def _installed(name: str) -> bool:
    return importlib.util.find_spec(name) is not None
