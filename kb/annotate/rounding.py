"""Logits to the scores that are kept: rounded to what every processor, backend and batch agrees on.

The same network gives other last bits with another instruction set, number of threads, backend or
shape of a batch. Measured on a BERT of the base size with random weights (logits from -7 to 9): by
torch, ONNX Runtime and OpenVINO in fp32, with their least and their widest instruction sets, one
and two threads, one and four windows a batch, no logit was more than 2.3e-5, no score more than
4e-6, from the one in float64. Four decimals are far above that, and far below what scores mean.

Rounding alone still splits two machines whose scores lie on the two sides of a tie. A window within
`ERROR` of one is therefore computed again in float64, where machines differ by about 1e-13. These
are few: scores near 0 and 1, as most are, move little with their logit. Reduced precisions are
rounded, and stay what the machine made them.
"""

from __future__ import annotations

from typing import Any

DECIMALS = 4  # the schemas say it too, as the unit of every score
ERROR = 1e-4  # of a logit in fp32; four times what was measured


def rounded(logits: Any) -> Any:
    """Scores between 0 and 1 (float64) of an array of logits, `DECIMALS` decimals."""
    import numpy as np

    return np.round(_scores(logits), DECIMALS)


def undecided(logits: Any) -> Any:
    """The numbers of the rows of logits (windows, classes) that another machine may round
    otherwise.
    """
    import numpy as np

    scores = _scores(logits)
    steps = scores * 10**DECIMALS
    to_tie = np.abs(steps - np.floor(steps) - 0.5)
    # A score moves by its slope, p (1 - p), times what its logit moves by.
    reach = ERROR * scores * (1.0 - scores) * 10**DECIMALS
    return np.flatnonzero((to_tie <= reach).any(axis=1))


def _scores(logits: Any) -> Any:
    import numpy as np

    return 1.0 / (1.0 + np.exp(-np.asarray(logits, dtype=np.float64)))
