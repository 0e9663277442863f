"""The same scores on every processor: what is kept here is what the least instruction sets give."""

import json
import os
import random
import subprocess
import sys
from pathlib import Path

import pytest

from kb.annotate import backends, inference
from tests.annotate.demo_texts import demo_texts
from tests.annotate.least import LIMITS
from tests.annotate.made import WORDS, checkpoint_of, make_checkpoint

LEAST = {**os.environ, **LIMITS, "OMP_WAIT_POLICY": "PASSIVE"}  # two threads that don't spin


pytestmark = pytest.mark.timeout(900)  # on a busy machine: backends without their fast kernels
ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def texts():
    """Some of the demo's, as eight runs score them; and many for random weights, whose scores lie
    anywhere between 0 and 1.
    """
    rng = random.Random(12)
    mixed = [" ".join(rng.choices(WORDS, k=rng.randint(1, 40))) for _ in range(120)]
    return demo_texts()[::30], mixed


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


def run(folder: Path, paths, texts, environment):
    """What `tests/annotate/least.py` answers in a process of its own."""
    jobs = [[str(path), each] for path, each in zip(paths, texts, strict=True)]
    (folder / "asked.json").write_text(json.dumps({"jobs": jobs}), encoding="utf-8")
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


@pytest.mark.slow
def test_the_least_instruction_sets_give_the_scores_that_are_kept(texts, kept, tmp_path):
    paths, rows = kept
    answer = run(tmp_path, paths, texts, LEAST)
    assert answer["torch"].upper() in ("DEFAULT", "NO AVX")
    for found, expected in zip(answer["scores"], rows, strict=True):
        assert found == {
            f"{name} {threads}": expected for name in ("onnxruntime", "torch") for threads in (1, 2)
        }


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

    step = f"steps of {10**-inference.DECIMALS:.4f}"
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
