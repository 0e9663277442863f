"""Which network runs: ONNX Runtime on the graph, or torch. In fp32 both give the same scores.

Measured on BERT's base size, in CPU seconds: ONNX Runtime scores 1.4 times as many texts as torch
in fp32 and 6 times as many with 8-bit weights; OpenVINO is 5 % ahead of it, which is not worth a
runtime that crashes where oneDNN is limited to fewer instructions.
"""

import os
import shutil
from functools import cache, partial
from pathlib import Path
from typing import Any

from kb.annotate.checkpoint import Checkpoint
from kb.annotate.detoxify_model import load_detoxify
from kb.annotate.inference import TOKEN_BUDGET, Meta, ModelNetwork, Runner
from kb.annotate.onnx_model import (
    find_compiled,
    graph_runner,
    int8_runner,
    make_compiled,
)
from kb.core.errors import MissingModel, SettingError

# Within this of a threshold a reduced score may fall on the other side; half of it was measured, on
# random weights (int8 without VNNI: 0.087). It ends between two rounded scores, so that none lies
# on its edge.
REACH = {"fp32": 0.0, "bf16": 0.04005, "int8": 0.15005}


def open_runner(
    checkpoint: Checkpoint, precision: str = "fp32", device: str = "cpu", threads: int = 1
) -> Runner:
    """ONNX Runtime for fp32 and int8 on a CPU, torch for all else and for a model without a graph.

    Raises MissingExtra, MissingModel.
    """
    os.environ.setdefault("RAYON_NUM_THREADS", str(threads))  # the tokenizer's own threads
    if device == "cuda" or precision == "bf16":
        return torch_runner(checkpoint, precision, device, threads)
    compiled = prepare(checkpoint)
    if precision == "int8":
        if compiled is None:
            raise MissingModel(
                f"{checkpoint.path} can't be scored in int8: its graph can't be built",
                hint="use bf16 or fp32",
            )
        return int8_runner(compiled, threads)
    if compiled is None:
        return torch_runner(checkpoint, precision, device, threads)
    return graph_runner(compiled, threads, exact=partial(exact, checkpoint, threads))


def check_options(precision: str, device: str, here: bool) -> None:
    """Raise SettingError for options that can't work; `here`: this machine does the scoring."""
    if precision == "int8" and device == "cuda":
        raise SettingError("--precision int8 runs on a CPU only", hint="use bf16 on a GPU")
    if here and device == "cuda":
        choose_device(device)


def prepare(checkpoint: Checkpoint) -> Path | None:
    """The folder of the checkpoint's graph, made unless it is there; None when it can't be made."""
    return find_compiled(checkpoint) or make_compiled(checkpoint)


def torch_network(model: Any, device: str, precision: str) -> ModelNetwork:
    """A transformers model in torch as a network."""
    import torch

    def network(ids: Any, mask: Any) -> Any:
        with torch.inference_mode():
            logits = model(
                input_ids=torch.from_numpy(ids).to(device),
                attention_mask=torch.from_numpy(mask).to(device),
            )[0]
        return logits.double().cpu().numpy()

    model.eval()
    if precision != "fp32":
        model.to({"bf16": torch.bfloat16, "fp64": torch.float64}[precision])
    return network


@cache
def exact(checkpoint: Checkpoint, threads: int) -> ModelNetwork:
    """The model in float64 by torch on the CPU; loaded once, when a window first needs it."""
    model = load_detoxify(checkpoint).model
    _use_threads(threads)
    return torch_network(model, "cpu", "fp64")


def _use_threads(threads: int) -> None:
    import torch

    torch.set_num_threads(threads)


def choose_device(wanted: str, precision: str = "fp32") -> str:
    """ "cpu" or "cuda" for `--device auto|cpu|cuda` on this machine.

    Raises SettingError when there is no GPU to use.
    """
    if wanted == "cpu" or (wanted == "auto" and precision == "int8"):
        return "cpu"
    # Importing torch takes seconds; without a driver there is nothing to ask it.
    if Path("/proc/driver/nvidia/version").exists() or shutil.which("nvidia-smi"):
        import torch

        if torch.cuda.is_available():
            return "cuda"
    if wanted == "cuda":
        raise SettingError(
            "--device cuda: torch finds no GPU",
            hint="use --device auto, or install a CUDA build of torch",
        )
    return "cpu"


def torch_runner(checkpoint: Checkpoint, precision: str, device: str, threads: int) -> Runner:
    """Detoxify's own model in torch."""
    detoxify = load_detoxify(checkpoint, device)
    if device == "cpu":
        _use_threads(threads)
    meta = Meta.of(detoxify)
    tokenizer = detoxify.tokenizer.backend_tokenizer
    tokenizer.no_padding()
    tokenizer.no_truncation()
    budget = TOKEN_BUDGET if device == "cpu" else 32 * TOKEN_BUDGET
    network = torch_network(detoxify.model, device, precision)
    in_float64 = partial(exact, checkpoint, threads) if precision == "fp32" else None
    return Runner("torch", network, tokenizer, meta, budget, in_float64)
