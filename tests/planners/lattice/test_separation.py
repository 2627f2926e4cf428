"""No path: the text names the wall, or where the widest passage is too narrow and by how much."""

import re

import numpy as np
import pytest
import shapely

from hpop.models import DifferentialDrive
from hpop.planners.graph_planners import Lattice
from hpop.problems.problem import Problem
from hpop.world import World

NARROW = re.compile(r"too narrow by about ([\d.]+) m, near \((-?[\d.]+), (-?[\d.]+)\)")


def note(obstacles, robot, *, step=0.25, start=(1.0, 4.0, 0.0), goal=(9.0, 4.0, 0.0), **options):
    world = World.from_polygons(obstacles, extent=shapely.box(0, 0, 10, 8))
    problem = Problem(world, robot, start, goal, ["length"])
    found = Lattice(step=step, **options).solve(problem)
    assert str(found.status) == "no path"
    assert len(found.trajectories) == 0
    return found.notes[-1]


def wall_with_gaps(x0, x1, *gaps):
    """Return a wall from x0 to x1 that is open between the given pairs of y."""
    edges = [0.0, *(y for gap in gaps for y in gap), 8.0]
    return [shapely.box(x0, low, x1, high) for low, high in zip(edges[::2], edges[1::2], strict=True)]


@pytest.mark.cases(
    but=(
        "5.0-0.05-0.1",
        "5.0-0.05-0.24",
        "5.0-0.3-0.01",
        "5.0-0.3-1.0",
        "5.13-0.05-0.01",
        "5.13-0.05-1.0",
        "5.13-0.3-0.1",
        "5.13-0.3-0.24",
    )
)
@pytest.mark.parametrize("thickness", [0.01, 0.1, 0.24, 1.0])
@pytest.mark.parametrize("radius", [0.05, 0.3])
@pytest.mark.parametrize("x", [5.0, 5.13])
def test_a_wall_closes_off_the_start_however_thin(thickness, radius, x):
    text = note(wall_with_gaps(x, x + thickness), DifferentialDrive(radius=radius))
    assert "obstacles separate start and goal, even for a robot of no size" in text
    far = float(re.search(r"spans x [\d.]+ to ([\d.]+) m", text)[1])
    assert x - 0.25 - 1e-9 <= far <= x


@pytest.mark.parametrize(("gap", "radius"), [((3.75, 4.25), 0.3), ((5.2, 5.8), 0.45), ((1.0, 1.5), 0.6)])
@pytest.mark.parametrize("thickness", [0.05, 1.0])
def test_a_passage_that_is_too_narrow_is_named_by_its_place_and_shortfall(gap, radius, thickness):
    text = note(wall_with_gaps(5.0, 5.0 + thickness, gap), DifferentialDrive(radius=radius))
    short, x, y = map(float, NARROW.search(text).groups())
    step = 0.25
    # A passage of width w is too narrow by 2 r - w; the lattice sees its middle to within half a step.
    assert 2 * radius - (gap[1] - gap[0]) - 0.01 <= short <= 2 * radius - (gap[1] - gap[0]) + step + 0.01
    assert gap[0] <= y <= gap[1]
    assert 5.0 - radius <= x <= 5.0 + thickness + radius


def test_of_two_passages_the_wider_is_named():
    text = note(wall_with_gaps(5.0, 5.5, (1.0, 1.2), (5.75, 6.25)), DifferentialDrive(radius=0.4))
    short, x, y = map(float, NARROW.search(text).groups())
    assert short == pytest.approx(0.3, abs=0.006)
    assert 5.75 < y < 6.25
    assert 4.6 <= x <= 5.9


def test_of_two_passages_in_a_row_the_narrower_is_named():
    walls = wall_with_gaps(3.0, 3.5, (3.75, 4.25)) + wall_with_gaps(6.0, 6.5, (3.875, 4.125))
    short, x, y = map(float, NARROW.search(note(walls, DifferentialDrive(radius=0.4))).groups())
    assert short == pytest.approx(0.55, abs=0.006)
    assert y == pytest.approx(4.0)
    assert 5.6 <= x <= 6.9


def test_a_passage_wide_enough_that_the_steps_miss_is_told_from_a_narrow_one():
    # Positions are on whole metres, and the only way is the diagonal from (4, 4) to (5, 5), between two corners.
    walls = [shapely.box(4.6, 0, 5.4, 4.4), shapely.box(3.6, 4.6, 4.4, 8)]
    robot = DifferentialDrive(radius=0.1)
    assert "there is room for the robot from start to goal, but the steps and turns" in note(walls, robot, step=1.0)
    world = World.from_polygons(walls, extent=shapely.box(0, 0, 10, 8))
    problem = Problem(world, robot, (1.0, 4.0, 0.0), (9.0, 4.0, 0.0), ["length"])
    assert str(Lattice(step=1.0, corner_cutting=True).solve(problem).status) == "complete"


def test_a_high_table_is_no_wall_for_a_low_robot():
    table = [(shapely.box(4, 0, 6, 8), (0.6, 0.8))]
    text = note(table, DifferentialDrive(camera_height=1.2))
    assert "obstacles separate start and goal" in text
    world = World.from_polygons(table, extent=shapely.box(0, 0, 10, 8))
    low = Problem(world, DifferentialDrive(camera_height=0.5), (1, 4, 0), (9, 4, 0), ["length"])
    assert str(Lattice().solve(low).status) == "complete"


def test_a_long_robot_that_fits_lengthwise_is_not_called_too_wide():
    # It could drive in, but has no room to turn round at the end, where the goal wants it to look back.
    robot = DifferentialDrive(footprint=((0.5, 0.2), (-0.5, 0.2), (-0.5, -0.2), (0.5, -0.2)))
    corridor = [shapely.box(5, 0, 10, 3.5), shapely.box(5, 4.5, 10, 8)]
    text = note(corridor, robot, goal=(9.0, 4.0, np.pi), step=0.5)
    assert "there is room for the robot from start to goal, but the steps and turns" in text
