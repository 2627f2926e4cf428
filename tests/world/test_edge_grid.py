"""Distances through buckets: against every edge, one by one."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hpop.world.edge_grid import EdgeGrid


def brute(edges, x, y):
    p, q = edges[:, :2], edges[:, 2:]
    d = q - p
    length2 = np.maximum((d**2).sum(axis=1), 1e-300)
    w = np.stack([x, y], axis=1)[:, None] - p
    t = np.clip((w * d).sum(axis=2) / length2, 0, 1)
    return np.linalg.norm(w - t[..., None] * d, axis=2).min(axis=1)


@given(seed=st.integers(0, 10_000), count=st.sampled_from([1, 2, 7, 60]), scale=st.sampled_from([0.01, 1, 30]))
def test_distances_are_those_of_the_nearest_edge(seed, count, scale):
    rng = np.random.default_rng(seed)
    starts = rng.uniform(-5, 5, (count, 2))
    edges = np.concatenate([starts, starts + rng.normal(scale=scale, size=(count, 2))], axis=1)
    x, y = rng.uniform(-30, 30, (2, 100))
    assert EdgeGrid.build(edges).distance(x, y) == pytest.approx(brute(edges, x, y), abs=1e-9)


@pytest.mark.parametrize(
    "edges",
    [
        [[0, 0, 0, 10]],
        [[0, 0, 10, 0], [0, 5, 10, 5]],
        [[3, 3, 3, 3]],
        [[0, 0, 100, 100], [0, 0.5, 0.1, 0.5], [0, 0.6, 0.1, 0.6], [0, 0.7, 0.1, 0.7]],
        [[-9753627.2, 5140874.3, -9753626.2, 5140874.3], [-9753620.0, 5140880.0, -9753620.0, 5140890.0]],
    ],
)
def test_flat_degenerate_long_and_far_away_edges(edges):
    edges = np.array(edges, dtype=float)
    rng = np.random.default_rng(1)
    x, y = edges[0, 0] + rng.uniform(-20, 120, 200), edges[0, 1] + rng.uniform(-20, 120, 200)
    assert EdgeGrid.build(edges).distance(x, y) == pytest.approx(brute(edges, x, y), abs=1e-8)


@pytest.mark.parametrize("count", [1, 2, 9, 200])
def test_edges_in_a_row_have_no_more_buckets_than_they_are(count):
    """Else a point far away looks through thousands of empty ones."""
    ends = np.linspace(0.0, 10.0, count + 1)
    for flat in (0.0, 1e-3):
        edges = np.stack([ends[:-1], 0.0 * ends[1:], ends[1:], flat + 0.0 * ends[1:]], axis=1)
        assert EdgeGrid.build(edges).rings.size <= count + 1
        assert EdgeGrid.build(edges[:, [1, 0, 3, 2]]).rings.size <= count + 1


def test_points_on_bucket_borders_and_corners_find_their_edge():
    lines = np.arange(11.0)
    zero, ten = np.zeros(11), np.full(11, 10.0)
    edges = np.concatenate([np.stack([lines, zero, lines, ten], axis=1), np.stack([zero, lines, ten, lines], axis=1)])
    x, y = (c.ravel() for c in np.meshgrid(lines, lines))
    assert EdgeGrid.build(edges).distance(x, y).tolist() == [0.0] * 121
    assert EdgeGrid.build(edges).distance(x + 0.5, y + 0.25)[0] == 0.25


def test_rings_count_the_empty_buckets_around():
    """Chessboard distance to the nearest bucket with edges, against all pairs."""
    points = np.random.default_rng(0).uniform(-1, 1, (60, 2)) + np.repeat([[0, 0], [50, 80]], 30, axis=0)
    grid = EdgeGrid.build(np.repeat(points, 2, axis=0).reshape(-1, 4))
    count = np.diff(grid.start).reshape(grid.rings.shape)
    full = np.argwhere(count)
    for cell in np.ndindex(*count.shape):
        assert grid.rings[cell] == np.abs(full - cell).max(axis=1).min()
    assert grid.rings.max() >= 3
