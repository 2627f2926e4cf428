"""Distances to the nearest edge: against every edge, one by one, and how much work they are."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hpop.world.geometry.planar import LEAF, EdgeTree


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
    assert EdgeTree.build(edges).distance(x, y) == pytest.approx(brute(edges, x, y), abs=1e-9)


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
    assert EdgeTree.build(edges).distance(x, y) == pytest.approx(brute(edges, x, y), abs=1e-8)


def test_points_on_edges_and_corners_are_at_no_distance():
    lines = np.arange(11.0)
    zero, ten = np.zeros(11), np.full(11, 10.0)
    edges = np.concatenate([np.stack([lines, zero, lines, ten], axis=1), np.stack([zero, lines, ten, lines], axis=1)])
    x, y = (c.ravel() for c in np.meshgrid(lines, lines))
    assert EdgeTree.build(edges).distance(x, y).tolist() == [0.0] * 121
    assert EdgeTree.build(edges).distance(x + 0.5, y + 0.25)[0] == 0.25


def circle(count, radius=10.0):
    angle = np.linspace(0.0, 2 * np.pi, count + 1)
    points = radius * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    return np.concatenate([points[:-1], points[1:]], axis=1)


def test_inside_an_outline_of_very_many_points_distances_are_those_to_the_circle():
    x, y = (c.ravel() for c in np.meshgrid(np.linspace(-7, 7, 40), np.linspace(-7, 7, 40)))
    found = EdgeTree.build(circle(100_000)).distance(x, y)
    assert found == pytest.approx(10.0 - np.hypot(x, y), abs=1e-7)


def visited(tree, x, y):
    """Boxes that a search for the nearest edge of each point has to look into: no farther than that edge."""
    low, high = tree.boxes[:, :2], tree.boxes[:, 2:]
    reach = tree.distance(x, y)
    for point, most in zip(np.stack([x, y], axis=1), reach, strict=True):
        away = np.maximum(np.maximum(low - point, point - high), 0.0)
        yield np.count_nonzero((away**2).sum(axis=1) <= most**2)


def test_the_work_of_a_point_grows_with_the_square_root_of_the_edges_at_the_most():
    """In a circle, the worst of outlines, nearly all edges are nearly as near. 32 times the edges: 6 times the work."""
    rng = np.random.default_rng(0)
    x, y = rng.uniform(-7, 7, (2, 200))
    few, many = (np.mean([*visited(EdgeTree.build(circle(count)), x, y)]) for count in (2**12, 2**17))
    assert few > 10
    assert many < 7 * few


def test_every_edge_is_within_its_leaf_and_every_box_within_the_one_above():
    rng = np.random.default_rng(1)
    starts = rng.uniform(-5, 5, (77, 2)) + 1e7
    edges = np.concatenate([starts, starts + rng.normal(size=(77, 2))], axis=1)
    tree = EdgeTree.build(edges)
    assert set(tree.members.ravel()) == set(range(77))
    assert tree.members.shape[1] == LEAF
    above = (np.arange(1, len(tree.boxes)) - 1) // 2
    assert (tree.boxes[above, :2] <= tree.boxes[1:, :2]).all()
    assert (tree.boxes[above, 2:] >= tree.boxes[1:, 2:]).all()
