"""Buckets of edges: no more of them than edges in a row."""

import numpy as np
import pytest

from hpop.world.geometry.planar import EdgeGrid


@pytest.mark.parametrize("count", [1, 2, 9, 200])
def test_edges_in_a_row_have_no_more_buckets_than_they_are(count):
    """Else a ray goes through thousands of empty ones."""
    ends = np.linspace(0.0, 10.0, count + 1)
    for flat in (0.0, 1e-3):
        edges = np.stack([ends[:-1], 0.0 * ends[1:], ends[1:], flat + 0.0 * ends[1:]], axis=1)
        assert EdgeGrid.build(edges).start.size <= count + 2
        assert EdgeGrid.build(edges[:, [1, 0, 3, 2]]).start.size <= count + 2
