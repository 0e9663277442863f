"""Which network runs: ONNX Runtime on the graph, or torch. In fp32 both give the same scores.

Measured on BERT's base size, in CPU seconds: ONNX Runtime scores 1.4 times as many texts as torch
in fp32 and 6 times as many with 8-bit weights; OpenVINO is 5 % ahead of it, which is not worth a
runtime that crashes where oneDNN is limited to fewer instructions. Importing torch alone takes
longer than scoring a small crawl.

A checkpoint's graph is exported once and kept in the user's cache. A new graph must agree with
Detoxify's own `predict` on probe texts, or it is discarded.
"""

import hashlib
import importlib.metadata
import json
import logging
import os
import shutil
import tempfile
import warnings
from collections.abc import Callable
from functools import cache, partial
from pathlib import Path
from typing import Any

import msgspec

from kb.annotate.detoxify_model import load_detoxify
from kb.annotate.inference import TOKEN_BUDGET, Meta, ModelNetwork, Runner
from kb.core.errors import MissingModel, SettingError
from kb.core.installation import cache_root, making
from kb.store.atomic import writing
from kb.store.checkpoint import Checkpoint, sha256_of, tokenizer_files

# Within this of a threshold a reduced score may fall on the other side; half of it was measured, on
# random weights (int8 without VNNI: 0.087). It ends between two rounded scores, so that none lies
# on its edge.
REACH = {"fp32": 0.0, "bf16": 0.04005, "int8": 0.15005}

FORMAT = 6  # raise it when the folder's files change meaning
TOLERANCE = 1e-4
_GRAPH, _QUANTIZED = "model.onnx", "model.int8.onnx"
PROBES = (
    "hello",
    "How to build a house in Minecraft",
    "you are a stupid idiot, shut up!",
    "1 2 3 … ünïcode 方块",
    "a longer text about redstone, pistons and hoppers; " * 4,
)


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


def cache_folder(checkpoint: Checkpoint) -> Path:
    """The cache folder for this checkpoint, configuration and version of torch."""
    parts = [
        str(FORMAT),
        checkpoint.sha256,
        *(_version(name) for name in ("torch", "transformers", "detoxify")),
    ]
    parts += [
        sha256_of(path)
        for path in [checkpoint.folder / "config.json", *tokenizer_files(checkpoint.folder)]
    ]
    return cache_root() / "compiled" / hashlib.sha256("\n".join(parts).encode()).hexdigest()[:24]


def find_compiled(checkpoint: Checkpoint) -> Path | None:
    """The cache folder with model.onnx, tokenizer.json and meta.json (see `Meta`), if complete."""
    folder = cache_folder(checkpoint)
    try:
        meta = json.loads((folder / "meta.json").read_text(encoding="utf-8"))
        is_complete = all(
            sha256_of(folder / name) == digest for name, digest in meta["files"].items()
        )
    except (OSError, ValueError, KeyError):
        return None
    return folder if is_complete else None


def make_compiled(checkpoint: Checkpoint) -> Path | None:
    """Export the graph; None if it disagrees with Detoxify."""
    detoxify = load_detoxify(checkpoint)
    folder = cache_folder(checkpoint)
    try:
        with making(folder, lambda: find_compiled(checkpoint) is not None) as fresh:
            _export(detoxify, fresh)
            if not _agrees(detoxify, fresh):
                raise _Differs
    except _Differs:
        return None
    except OSError:  # the cache is not writable: export for this run only
        fresh = Path(tempfile.mkdtemp(prefix="kb-compiled-"))
        _export(detoxify, fresh)
        return fresh if _agrees(detoxify, fresh) else None
    return folder


class _Differs(Exception):
    pass


def _export(detoxify: Any, folder: Path) -> None:
    import torch

    ids = torch.ones((2, 7), dtype=torch.long)
    mask = torch.ones((2, 7), dtype=torch.long)
    mask[1, 5:] = 0
    axes = {0: "windows", 1: "tokens"}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        # The tracing exporter: the newer one needs onnxscript and gives the same graph for BERT.
        torch.onnx.export(
            detoxify.model,
            (ids, mask),
            str(folder / _GRAPH),
            dynamo=False,
            opset_version=17,
            input_names=["input_ids", "attention_mask"],
            output_names=["logits"],
            dynamic_axes={"input_ids": axes, "attention_mask": axes, "logits": {0: "windows"}},
        )
    detoxify.tokenizer.backend_tokenizer.save(str(folder / "tokenizer.json"))
    meta = Meta.of(detoxify)
    files = {path.name: sha256_of(path) for path in sorted(folder.iterdir())}
    about = {**msgspec.structs.asdict(meta), "files": files}
    (folder / "meta.json").write_bytes(msgspec.json.encode(about))


def _agrees(detoxify: Any, compiled: Path) -> bool:
    runner = graph_runner(compiled, threads=1)
    own = runner.score(list(PROBES))
    for text, row in zip(PROBES, own, strict=True):
        theirs = detoxify.predict(text)
        if any(
            abs(theirs[name] - score) > TOLERANCE
            for name, score in zip(runner.meta.classes, row, strict=True)
        ):
            return False
    return True


def _version(name: str) -> str:
    try:
        return importlib.metadata.version(name)
    except importlib.metadata.PackageNotFoundError:
        return ""


def graph_runner(
    compiled: Path, threads: int, exact: Callable[[], ModelNetwork] | None = None
) -> Runner:
    """The graph in fp32; `exact` as in `Runner`."""
    return _runner(compiled, _GRAPH, threads, exact)


def int8_runner(compiled: Path, threads: int) -> Runner:
    """The graph with 8-bit weights, quantized once."""
    quantized = compiled / _QUANTIZED
    if not quantized.exists():
        from onnxruntime.quantization import QuantType, quantize_dynamic

        with writing(quantized) as fresh:
            root = logging.getLogger()
            before = root.level
            # It advises to preprocess the graph, which changes nothing for BERT.
            root.setLevel(logging.ERROR)
            try:
                quantize_dynamic(str(compiled / _GRAPH), str(fresh), weight_type=QuantType.QInt8)
            finally:
                root.setLevel(before)
    return _runner(compiled, _QUANTIZED, threads)


def _runner(
    compiled: Path, graph: str, threads: int, exact: Callable[[], ModelNetwork] | None = None
) -> Runner:
    import onnxruntime
    from tokenizers import Tokenizer

    onnxruntime.disable_telemetry_events()  # in addition to kb.core.startup
    onnxruntime.set_default_logger_severity(3)
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads, options.inter_op_num_threads = threads, 1
    session = onnxruntime.InferenceSession(
        str(compiled / graph), options, providers=["CPUExecutionProvider"]
    )

    def network(ids: Any, mask: Any) -> Any:
        return session.run(None, {"input_ids": ids, "attention_mask": mask})[0]

    tokenizer = Tokenizer.from_file(str(compiled / "tokenizer.json"))
    tokenizer.no_padding()
    tokenizer.no_truncation()
    meta = msgspec.json.decode((compiled / "meta.json").read_bytes(), type=Meta)
    return Runner("onnxruntime", network, tokenizer, meta, exact=exact)
