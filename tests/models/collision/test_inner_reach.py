"""States that the disc within a part decides: against outlines placed one by one."""

from __future__ import annotations

import math

import numpy as np
import pytest
import shapely
from shapely.affinity import rotate, translate

from hpop.models.collision import Part
from hpop.models.collision.planar import PlanarCollision
from hpop.motions import States
from hpop.world import World

SQUARE = ((0.3, 0.2), (-0.3, 0.2), (-0.3, -0.2), (0.3, -0.2))
PARTS = {
    "rectangle": (Part(SQUARE, 0.0, 0.0, 1.0), 0.2),
    "rounded": (Part(SQUARE, 0.1, 0.0, 1.0), 0.3),
    "beside the axis": (Part(tuple((x + 0.5, y) for x, y in SQUARE), 0.0, 0.0, 1.0), 0.0),
    "disc beside the axis": (Part(((0.1, 0.0),), 0.25, 0.0, 1.0), 0.15),
    "bar": (Part(((-0.2, 0.0), (0.3, 0.0)), 0.1, 0.0, 1.0), 0.1),
}


@pytest.mark.parametrize("name", PARTS)
def test_inner_reach_is_the_radius_of_the_largest_disc_about_the_axis(name):
    part, expected = PARTS[name]
    assert part.inner_reach == pytest.approx(expected)


@pytest.mark.parametrize("name", PARTS)
def test_states_are_free_where_their_outlines_are(name):
    part, _ = PARTS[name]
    rng = np.random.default_rng(5)
    cells = rng.random((14, 14)) < 0.12
    rows, columns = np.nonzero(cells)
    blocked = shapely.union_all(shapely.box(columns / 2, rows / 2, columns / 2 + 0.5, rows / 2 + 0.5))
    free = shapely.difference(shapely.box(0, 0, 7, 7), blocked)
    x, y = np.repeat(rng.uniform(-0.2, 7.2, (2, 300)), 4, axis=1)  # four yaws at each position
    yaw = rng.uniform(0, 2 * math.pi, x.size)
    outline = shapely.convex_hull(shapely.MultiPoint(part.corners))
    room = shapely.buffer(free, -part.radius, quad_segs=200) if part.radius else free
    placed = [
        translate(rotate(outline, turn, origin=(0, 0), use_radians=True), *at)
        for turn, *at in zip(yaw.tolist(), x.tolist(), y.tolist(), strict=True)
    ]
    expected = shapely.covers(room, placed)
    near = np.abs(shapely.distance(free.boundary, placed) - part.radius) < 1e-4  # arcs of the oracle are polygons
    result = PlanarCollision((part,), World.from_cells(cells, 0.5)).states_free(States(x=x, y=y, yaw=yaw))
    assert (result == expected)[~near | (part.radius == 0)].all()
    assert 100 < result.sum() < 1_000
