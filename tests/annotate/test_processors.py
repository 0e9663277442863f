"""The same scores on every processor: what is kept here is what the least instruction sets give."""

from __future__ import annotations

import json
import os
import random
import subprocess
import sys
from pathlib import Path

import pytest

from kb.annotate import backends, rounding
from kb.annotate.graph import installed
from kb.annotate.processor import suits_openvino
from tests.annotate.demo_texts import demo_texts
from tests.annotate.least import LEAST, OPENVINO_RUNS
from tests.annotate.made import WORDS, checkpoint_of, make_checkpoint

pytestmark = pytest.mark.timeout(
    900
)  # on a busy machine: three backends without their fast kernels
BACKENDS = ["torch", "onnxruntime", "openvino"]
ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def texts():
    """Of the demo each third, as eight runs score them; and many for random weights, whose scores
    lie anywhere between 0 and 1.
    """
    rng = random.Random(12)
    mixed = [" ".join(rng.choices(WORDS, k=rng.randint(1, 40))) for _ in range(250)]
    return demo_texts()[::3], mixed


@pytest.fixture(scope="module")
def kept(tiny, texts, tmp_path_factory):
    """The scores as this machine keeps them, by whatever backend it takes; the checkpoints."""
    random_weights = make_checkpoint(tmp_path_factory.mktemp("made") / "model")
    paths = (tiny, random_weights)
    runners = [backends.open_runner(checkpoint_of(path), threads=2) for path in paths]
    rows = [runner.score(each) for runner, each in zip(runners, texts, strict=True)]
    assert runners[1].exactly, (
        "no window was near a tie: that they are computed again shows nothing"
    )
    return paths, rows


def run(folder: Path, paths, texts, names, environment):
    """What `tests/annotate/least.py` answers in a process of its own."""
    jobs = [[str(path), each] for path, each in zip(paths, texts, strict=True)]
    (folder / "asked.json").write_text(json.dumps({"jobs": jobs, "names": names}), encoding="utf-8")
    words = [sys.executable, "-m", "tests.annotate.least", "asked.json", "answer.json"]
    done = subprocess.run(
        [*words[:3], *(str(folder / name) for name in words[3:])],
        env=environment,
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return json.loads((folder / "answer.json").read_text(encoding="utf-8"))


def test_the_least_instruction_sets_give_the_scores_that_are_kept(texts, kept, tmp_path):
    """OpenVINO can't be limited as far and isn't tried; the next runtime's scores are the same."""
    paths, rows = kept
    answer = run(tmp_path, paths, texts, BACKENDS, LEAST)
    assert answer["torch"].upper() in ("DEFAULT", "NO AVX")
    for found, expected in zip(answer["scores"], rows, strict=True):
        assert found["chosen"] == ("onnxruntime" if installed("onnxruntime") else "torch")
        for threads in (1, 2):
            assert found[f"openvino {threads}"] is None
            assert found[f"torch {threads}"] == expected
            if installed("onnxruntime"):
                assert found[f"onnxruntime {threads}"] == expected


@pytest.mark.skipif(not installed("openvino"), reason="needs openvino")
def test_openvino_gives_them_with_all_other_limits(texts, kept, tmp_path):
    paths, rows = kept
    answer = run(tmp_path, paths, texts, ["openvino"], OPENVINO_RUNS)
    for found, expected in zip(answer["scores"], rows, strict=True):
        for threads in (1, 2):
            given = found[f"openvino {threads}"]
            assert given == expected if suits_openvino({}) else given is None


def test_a_limit_under_which_openvino_crashes_gives_the_next_runtime(texts, kept, tmp_path):
    """By this variable alone, on a processor with AVX-512: its kernels are wider than asked for."""
    paths, _ = kept
    environment = {**os.environ, "ONEDNN_MAX_CPU_ISA": "AVX2"}
    answer = run(tmp_path, paths, texts, [], environment)  # SIGSEGV would be -11, not 0
    next_one = "onnxruntime" if installed("onnxruntime") else "torch"
    assert [found["chosen"] for found in answer["scores"]] == [next_one] * 2


@pytest.mark.parametrize(
    ("flags", "environ", "suits"),
    [
        ("fpu sse4_2 avx fma avx2", {}, True),
        ("fpu sse4_2 avx fma avx2", {"ONEDNN_MAX_CPU_ISA": "all", "DNNL_MAX_CPU_ISA": ""}, True),
        ("fpu sse4_2 avx", {}, False),
        ("fpu sse4_2 avx fma avx2 avx512f", {"ONEDNN_MAX_CPU_ISA": "AVX2"}, False),
        ("fpu sse4_2 avx fma avx2 avx512f", {"DNNL_MAX_CPU_ISA": "SSE41"}, False),
        ("fpu sse4_2 avx fma avx2 avx512f", {"ONEDNN_CPU_ISA_HINTS": "PREFER_YMM"}, False),
        (None, {}, False),
    ],
)
def test_openvino_is_left_where_it_may_crash(tmp_path, flags, environ, suits):
    """Its SIGSEGV (a limit below the processor's own) is one that no `except` catches."""
    cpuinfo = tmp_path / "cpuinfo"
    if flags is not None:
        # Two kinds of cores, as some machines have: what one of them lacks, no kernel may use.
        cpuinfo.write_text(f"processor\t: 0\nflags\t\t: {flags} amx\n\nflags\t\t: {flags}\n")
    assert suits_openvino(environ, "x86_64", cpuinfo) is suits
    assert suits_openvino({}, "aarch64", cpuinfo), "left to the probe batches"


def test_windows_near_a_tie_are_decided_in_float64(kept, texts):
    """Rounding alone splits machines: noise as large as they differ by moves scores over a tie."""
    import numpy as np

    (_, path), (_, rows) = kept
    checkpoint = checkpoint_of(path)
    runner = backends.torch_runner(checkpoint, "fp32", "cpu", 1)
    own, rng = runner._network, np.random.default_rng(3)

    def noisy(ids, mask):
        logits = own(ids, mask)
        return logits + rng.uniform(-5e-5, 5e-5, logits.shape)

    runner._network = noisy
    assert runner.score(texts[1]) == rows
    runner._exact = None
    assert runner.score(texts[1]) != rows


def test_scores_are_rounded_once_to_the_digits_that_the_schemas_say():
    from kb.schema.tables import table

    step = f"steps of {10**-rounding.DECIMALS:.4f}"
    names = (
        "shared/annotations",
        "youtube/videos",
        "reddit/posts",
        "reddit/comments",
        "wiki/pages",
    )
    for name in names:
        columns = [column for column in table(name).columns if column.name.startswith("toxicity")]
        assert columns, name
        assert all(step in column.unit for column in columns), name
