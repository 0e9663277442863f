"""Whether OpenVINO can be trusted with this processor, found out without calling it.

OpenVINO asks the processor itself for some of its kernels and oneDNN for others, and oneDNN can be
limited by variables. A limit makes the two disagree about the width of a vector: with SSE41 it
raises or answers with no rows, with AVX or AVX2 on a processor with AVX-512 it crashes (SIGSEGV),
which no `except` catches. So it is taken only where nothing limits oneDNN, and where the processor
has AVX2, the least that its own kernels are made for; ONNX Runtime and torch run anywhere.
"""

from __future__ import annotations

import os
import platform
from collections.abc import Mapping
from functools import cache
from pathlib import Path

_X86 = ("x86_64", "amd64", "i386", "i686")
_NEEDED = {"avx2", "fma"}
_LIMITS = ("MAX_CPU_ISA", "CPU_ISA_HINTS")  # after the library's name of today and its older one
_NO_LIMIT = ("", "all", "default", "no_hints")


def suits_openvino(
    environ: Mapping[str, str] | None = None,
    machine: str | None = None,
    cpuinfo: Path = Path("/proc/cpuinfo"),
) -> bool:
    """Whether the processor has what OpenVINO needs, and no variable limits oneDNN.

    An x86 processor that nothing is known of (no `cpuinfo`) counts as one that lacks it; others
    are left to the probe batches (kb/annotate/graph.py).
    """
    environ = os.environ if environ is None else environ
    if any(
        _limited(environ, f"{library}_{name}") for library in ("ONEDNN", "DNNL") for name in _LIMITS
    ):
        return False
    machine = (machine or platform.machine()).lower()
    return machine not in _X86 or _features(cpuinfo) >= _NEEDED


def _limited(environ: Mapping[str, str], name: str) -> bool:
    return environ.get(name, "").strip().lower() not in _NO_LIMIT


@cache
def _features(cpuinfo: Path) -> frozenset[str]:
    """What every processor of this machine has, as Linux names it."""
    try:
        lines = cpuinfo.read_text(encoding="utf-8", errors="replace").splitlines()
    except OSError:
        return frozenset()
    cores = [
        frozenset(line.partition(":")[2].split()) for line in lines if line.startswith("flags")
    ]
    return frozenset.intersection(*cores) if cores else frozenset()
