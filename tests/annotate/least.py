"""The least instruction sets that this machine's libraries can be told to use; run as a script,
scores.

    ATEN_CPU_CAPABILITY, MKL_CBWR, ONEDNN_MAX_CPU_ISA, OPENBLAS_CORETYPE   torch and what it calls
    NPY_DISABLE_CPU_FEATURES                                              numpy's own loops
    GLIBC_TUNABLES                                                        the C library's exp, log

ONNX Runtime asks the processor itself and has no switch.
"""

import json
import sys
from pathlib import Path


def _features() -> str:
    """What numpy finds out about the processor while it runs; it refuses to leave out the rest."""
    try:
        from numpy._core._multiarray_umath import __cpu_dispatch__, __cpu_features__
    except ImportError:
        return ""
    return " ".join(name for name in __cpu_dispatch__ if __cpu_features__.get(name))


LIMITS = {
    "ATEN_CPU_CAPABILITY": "default",
    "ONEDNN_MAX_CPU_ISA": "SSE41",
    "DNNL_MAX_CPU_ISA": "SSE41",
    "MKL_CBWR": "COMPATIBLE",
    "OPENBLAS_CORETYPE": "Prescott",
    "NPY_DISABLE_CPU_FEATURES": _features(),
    "GLIBC_TUNABLES": "glibc.cpu.hwcaps=-AVX2,-AVX512F,-FMA,-FMA4,-BMI2",
}


def scores(checkpoint_path: str, texts: list[str]) -> dict[str, list]:
    """Scores of the texts by each backend with one and with two threads, as they are kept."""
    from kb.annotate import backends
    from tests.annotate.made import checkpoint_of

    checkpoint = checkpoint_of(Path(checkpoint_path))
    found = {}
    for threads in (1, 2):
        for make in (backends.open_runner, backends.torch_runner):
            runner = make(checkpoint, "fp32", "cpu", threads)
            found[f"{runner.name} {threads}"] = runner.score(texts)
    return found


if __name__ == "__main__":
    asked = json.loads(Path(sys.argv[1]).read_text(encoding="utf-8"))
    answers = [scores(path, texts) for path, texts in asked["jobs"]]
    answer = {"torch": __import__("torch").backends.cpu.get_cpu_capability(), "scores": answers}
    Path(sys.argv[2]).write_text(json.dumps(answer), encoding="utf-8")
