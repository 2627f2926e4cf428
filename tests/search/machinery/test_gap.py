"""Claim: the gap that a kernel proves of many estimates is the one that NumPy proves of all pairs."""

from __future__ import annotations

import math

import numpy as np
import pytest

from hpop.search import machinery
from hpop.search.machinery.kernels import proven_gap


@pytest.mark.seeds(8, of=150)
def test_it_is_the_largest_of_the_least_excesses(seed: int) -> None:
    rng = np.random.default_rng(seed)
    k = 1 + seed % 5
    front, estimates = (rng.integers(0, (4, 1000)[seed % 2], (int(n), k)) for n in rng.integers(1, 60, 2))
    expected = machinery.proven_gap(front, estimates)
    assert proven_gap(front, estimates, math.inf) == expected
    assert (proven_gap(front, estimates, 0.1) >= 0.1) == (expected >= 0.1)


def test_nothing_that_may_be_missing_is_no_gap_and_nothing_found_is_any() -> None:
    nothing, some = np.zeros((0, 2), np.int64), np.ones((1, 2), np.int64)
    assert proven_gap(some, nothing, math.inf) == 0
    assert proven_gap(nothing, some, math.inf) == math.inf
