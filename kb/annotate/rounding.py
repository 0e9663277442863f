"""Logits to the scores that are kept: rounded to what every processor, backend and batch agrees on.

The same network gives other last bits with another instruction set, number of threads, backend or
shape of a batch. Measured on a BERT of the base size with random weights, logits between -9 and 9,
over torch, ONNX Runtime and OpenVINO in fp32, their least and their widest instruction sets, one
and two threads, one and four windows a batch: no logit is more than MEASURED from the one in
float64. Rounding alone would still split two machines whose scores lie on the two sides of a tie,
so a window that is within `ERROR` of one is computed again in float64, where machines differ
by 1e-13; of a crawl's windows these are few, because scores near 0 and 1 move little with their logit.
"""

from __future__ import annotations

from typing import Any

DECIMALS = 4  # the schemas say it too, as the unit of every score
ERROR = 1e-4  # of a logit in fp32


def rounded(logits: Any) -> Any:
    """Scores between 0 and 1 (float64) of an array of logits, `DECIMALS` decimals."""
    import numpy as np

    return np.round(_scores(logits), DECIMALS)


def undecided(logits: Any) -> Any:
    """The numbers of the rows of logits (windows, classes) that another machine may round otherwise."""
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
