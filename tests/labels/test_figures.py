"""Agreement of people, against examples that others have worked out."""

import numpy as np
import pytest

from kb.labels.imports import agreement


def test_cohens_kappa_of_a_known_table() -> None:
    """Two readers of 50 grant proposals: 20 both yes, 15 both no, 5 and 10 apart: 0.4."""
    pairs = [(1, 1)] * 20 + [(1, 0)] * 5 + [(0, 1)] * 10 + [(0, 0)] * 15 + [(1, -1)] * 9
    found = agreement(np.array(pairs), 2)
    assert found == {"method": "cohen", "items": 50, "agreed": 0.7, "kappa": 0.4}


def test_fleiss_kappa_of_a_known_table() -> None:
    """Fourteen people, ten subjects, five categories (Fleiss's example as it is taught): 0.210."""
    counts = [
        [0, 0, 0, 0, 14],
        [0, 2, 6, 4, 2],
        [0, 0, 3, 5, 6],
        [0, 3, 9, 2, 0],
        [2, 2, 8, 1, 1],
        [7, 7, 0, 0, 0],
        [3, 2, 6, 3, 0],
        [2, 5, 3, 2, 2],
        [6, 5, 2, 1, 0],
        [0, 2, 2, 3, 7],
    ]
    found = agreement(np.array([np.repeat(range(5), row) for row in counts]), 5)
    assert (found["method"], found["items"]) == ("fleiss", 10)
    assert found["kappa"] == pytest.approx(0.210, abs=5e-4)
    assert found["agreed"] == pytest.approx(0.378, abs=5e-4)


def test_nothing_is_said_where_nothing_is_shared_or_differs() -> None:
    assert agreement(np.array([[0, -1], [-1, 1]]), 2)["items"] == 0
    assert agreement(np.array([[0, 0], [0, 0]]), 1)["kappa"] is None
