"""Corners: a vector that no solution covers lies below one of them, and no other does."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from hpop.search.timed.solutions import cut_corners

MOST = 4


@given(
    st.integers(1, 3).flatmap(lambda k: st.lists(st.lists(st.integers(0, MOST), min_size=k, max_size=k), min_size=1)),
)
def test_corners_are_above_exactly_what_is_not_covered(solutions: list[list[int]]) -> None:
    k = len(solutions[0])
    corners = np.full((1, k), MOST)
    for solution in solutions:
        corners = cut_corners(corners, np.array(solution))
    for vector in np.ndindex(*[MOST + 1] * k):
        covered = any(all(s <= v for s, v in zip(solution, vector, strict=True)) for solution in solutions)
        assert (np.array(vector) <= corners).all(axis=1).any() != covered
    within = (corners[:, None] <= corners[None]).all(axis=2).sum(axis=1)
    assert (within == 1).all(), "a corner lies within another"
