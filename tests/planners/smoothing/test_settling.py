"""The last steps of smoothing, by the length of a string that is pulled taut round a block."""

import math

import pytest
import shapely

import hpop
from hpop.planners import Smoothing


def taut(left, right, height, far, radius):
    """Return the shortest path, m, of a disc from (0, 0) over a block to (far, 0): tangents, arcs, the top."""

    def side(x):
        """Tangent from the end to the circle round the corner, and the arc up to the top of the block."""
        away = math.hypot(x, height)
        tangent = math.sqrt(away**2 - radius**2)
        slope = math.atan2(height, x) + math.asin(radius / away)
        return tangent + radius * slope

    return side(left) + (right - left) + side(far - right)


@pytest.mark.parametrize("height", [0.6, pytest.param(0.9, marks=pytest.mark.proof)])
def test_the_shortest_drive_round_a_block_is_a_taut_string(height):
    """Within 2.5e-3: speed on the arcs is limited by wheel accelerations, and a rest of the weight of time is left."""
    block = shapely.box(2.8, 2.0 - 0.8 * height, 3.4, 2.0 + height)
    world = hpop.World.from_polygons([block], extent=shapely.box(0, 0, 6, 4))
    above = [(1.0, 2.0, 0.0), (2.6, 2.0 + height + 0.4, 0.0), (3.6, 2.0 + height + 0.4, 0.0), (5.0, 2.0, 0.0)]
    problem = hpop.Problem(world, hpop.DifferentialDrive(radius=0.25), (1, 2, 0), (5, 2, 0), ["length", "turns"])
    warm = hpop.Trajectory.from_poses(problem.model, above)
    found = Smoothing(minimise="length", warm_start=[warm]).solve(problem)
    (length,) = found.planned[:, 0]
    assert taut(1.8, 2.4, height, 4.0, 0.25) - 1e-6 < length < taut(1.8, 2.4, height, 4.0, 0.25) * (1 + 1e-3)
    assert found.provenance[0]["settled"]
