"""Convex regions and corridors: free of obstacles, with their paths inside, and distances that are bounded rightly."""

from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st

from hpop.criteria.base import make_criterion
from hpop.criteria.costs import trajectory_costs
from hpop.models import DifferentialDrive
from hpop.planners import Lattice
from hpop.planners.programs.corridor.corridor import FreeRegion, HalfPlanes, clear_of, corridors, spaces
from hpop.planners.programs.corridor.program import CorridorProgram
from hpop.planners.programs.polyline import Polyline
from hpop.problems.problem import Problem
from hpop.world import World

ROBOT = DifferentialDrive(radius=0.3, camera_height=1.2)
MUSEUM = Path(__file__).parents[3] / "examples" / "museum.geojson"
ROOM = World.from_polygons([shapely.box(2, 2, 3, 3)], extent=shapely.box(0, 0, 6, 6))


def paths(problem, step):
    """Return the polylines of the lattice's front."""
    return [Polyline.of(t, problem) for t in problem.solve(Lattice(step=step)).trajectories]


def museum():
    return Problem(World.from_geojson(MUSEUM), ROBOT, (2, 10, 0), (28, 10, 0), ["length", "turns", "clearance"]), 0.5


def office(shared_data):
    world = World.from_ros_map(shared_data("pal_office") / "map.yaml")
    return Problem(world, ROBOT, (6, -8, np.pi / 2), (-10, 1, None), ["length", "turns", "clearance"]), 0.5


@pytest.mark.parametrize("name", ["museum", pytest.param("pal_office", marks=pytest.mark.proof)])
def test_regions_are_free_contain_their_segments_and_overlap_at_the_vertices(name, shared_data):
    problem, step = museum() if name == "museum" else office(shared_data)
    polylines = paths(problem, step)
    found, refused = corridors(polylines, problem)
    assert refused == 0
    assert sorted(i for corridor in found for i in corridor.warm_starts) == list(range(len(polylines)))
    for corridor in found:
        for region, segment in zip(corridor.regions, pairwise(corridor.warm.vertices), strict=True):
            polygon = region.inside.polygon
            assert region.safe
            assert polygon.is_valid
            assert polygon.buffer(1e-8).covers(shapely.linestrings(np.array(segment)))
            for space, reach in spaces(problem.model, problem.world):
                # the border of the free space, and so every obstacle, is beyond the robot's reach
                assert space.region.buffer(1e-9).covers(polygon)
                assert space.region.boundary.distance(polygon) >= reach - 1e-8
        for i, overlap in enumerate(corridor.overlaps, start=1):
            assert overlap.excess(corridor.warm.vertices[i][None])[0] <= 1e-9
            both = shapely.intersection(corridor.regions[i - 1].inside.polygon, corridor.regions[i].inside.polygon)
            assert overlap.polygon.area == pytest.approx(both.area, abs=1e-6)


def test_paths_through_the_same_regions_share_a_corridor():
    problem = Problem(ROOM, ROBOT, (1, 1, 0), (5, 5, 0), ["length"])
    low = Polyline(np.array([[1.0, 1.0], [5.0, 1.0], [5.0, 5.0]]), 0.0, 0.0)
    near = Polyline(np.array([[1.0, 1.0], [4.8, 1.0], [5.0, 5.0]]), 0.0, 0.0)
    high = Polyline(np.array([[1.0, 1.0], [1.0, 5.0], [5.0, 5.0]]), 0.0, 0.0)
    found, _ = corridors([low, near, high], problem)
    assert [corridor.warm_starts for corridor in found] == [(0, 1), (2,)]


def test_the_region_beside_a_box_is_the_room_less_the_reach():
    """A segment below the box: the half-plane of its lower side, and the room's walls, each less 0.3 m."""
    region = FreeRegion.around(np.array([[1.0, 1.0], [5.0, 1.0]]), ROBOT, ROOM)
    assert region is not None
    assert region.inside.polygon.symmetric_difference(shapely.box(0.3, 0.3, 5.7, 1.7)).area < 1e-6


def test_a_path_that_touches_has_no_region():
    assert FreeRegion.around(np.array([[1.0, 1.0], [5.0, 5.0]]), ROBOT, ROOM) is None


def test_a_robot_that_fits_only_one_way_keeps_the_distance_of_its_path():
    oblong = DifferentialDrive(footprint=((0.6, 0.2), (-0.6, 0.2), (-0.6, -0.2), (0.6, -0.2)))
    hall = World.from_polygons([], extent=shapely.box(0, 0, 8, 1))
    segment = np.array([[1.0, 0.5], [7.0, 0.5]])
    region = FreeRegion.around(segment, oblong, hall)
    assert region is not None
    assert not region.safe
    assert region.covers(segment)
    assert not region.covers(segment + np.array([0.0, 0.01]))


boxes = st.lists(st.tuples(*[st.floats(0.5, 7.0)] * 2, *[st.floats(0.1, 1.5)] * 2), min_size=1, max_size=8)


@given(boxes, st.tuples(*[st.floats(0.5, 7.5)] * 4), st.integers(0, 2**31))
def test_half_planes_bound_the_distance_from_below_everywhere(sizes, ends, seed):
    world = World.from_polygons(
        [shapely.box(x, y, x + w, y + h) for x, y, w, h in sizes], extent=shapely.box(0, 0, 9, 9)
    )
    space, segment = world.free_space(), np.array(ends).reshape(2, 2)
    clear = clear_of(space, segment, 3.0)
    touches = (
        not space.region.covers(shapely.linestrings(segment))
        or space.region.boundary.distance(shapely.linestrings(segment)) < 1e-6
    )
    assert (clear is None) == touches
    if clear is None:
        return
    assert (clear.excess(segment) <= 1e-9).all()
    points = np.random.default_rng(seed).uniform(-1, 10, (500, 2))
    assert (-clear.excess(points) <= space.clearance(*points.T) + 1e-9).all()
    # tangent to the nearest obstacle
    reach = shapely.linestrings(segment).distance(space.region.boundary)
    assert (clear.offsets - (segment @ clear.normals.T).max(axis=0)).min() == pytest.approx(min(reach, 3.0), abs=1e-9)


@given(st.lists(st.tuples(st.floats(0, 6.2), st.floats(0.2, 2.0)), max_size=6), st.tuples(*[st.floats(-5, 5)] * 2))
def test_cutting_is_the_intersection_of_half_planes(lines, point):
    box = HalfPlanes.box(np.zeros((1, 2)), 3.0)
    normals = np.array([[np.cos(a), np.sin(a)] for a, _ in lines]).reshape(-1, 2)
    left, at = box.cut(normals, np.array([b for _, b in lines])), np.array(point)
    expected = shapely.box(-3, -3, 3, 3)
    for (a, b), way in zip(lines, normals, strict=True):
        side = np.array([-np.sin(a), np.cos(a)])
        half = shapely.Polygon(
            [b * way + 20 * side, b * way - 20 * side, (b - 20) * way - 20 * side, (b - 20) * way + 20 * side]
        )
        expected = expected.intersection(half)
    assert left.polygon.symmetric_difference(expected).area < 1e-9
    nearest = left.nearest(at)
    assert left.excess(nearest[None])[0] <= 1e-12 + 1e-9
    assert np.hypot(*(nearest - at)) == pytest.approx(expected.distance(shapely.Point(*at)), abs=1e-9)


def test_nothing_is_left():
    with pytest.raises(ValueError, match="got an empty intersection"):
        HalfPlanes.box(np.zeros((1, 2)), 1.0).cut(np.array([[1.0, 0.0]]), np.array([-2.0]))


OFFSET = DifferentialDrive(radius=0.3, camera_offset=(0.1, 0.05))


@pytest.mark.cases("spec0-robot1", "spec1-robot0", "length-robot0")
@pytest.mark.parametrize("robot", [ROBOT, OFFSET])
@pytest.mark.parametrize("spec", [{"clearance": {"enough": 1.5}}, {"passing_distance": {"enough": 0.8}}, "length"])
def test_convex_forms_are_what_they_declare_on_any_vertices_of_the_corridor(robot, spec):
    """Random vertices in the overlaps: an exact form is the cost, a bound is not below it."""
    problem = Problem(World.from_geojson(MUSEUM), robot, (2, 10, 0), (28, 10, 0), ["length", "turns"])
    criterion, rng = make_criterion(spec), np.random.default_rng(1)
    above = []
    for corridor in corridors(paths(problem, 1.0), problem)[0]:
        program = CorridorProgram(corridor, (criterion,), problem.world, robot, ("CLARABEL",))
        for _ in range(5):
            vertices = program.base.copy()
            for i, overlap in enumerate(corridor.overlaps, start=1):
                vertices[i] = rng.dirichlet(np.ones(len(overlap.corners))) @ overlap.corners
                if i in program.rays:  # anywhere nearer to the end of the ray, where that is inside
                    end, _ = program.rays[i]
                    at = end + rng.uniform(0.0, 1.0) * (program.base[i] - end)
                    vertices[i] = at if overlap.excess(at[None])[0] <= 0 else program.base[i]
            planned = program.evaluate(vertices)[0]
            trajectory = program.polyline(vertices).trajectory(robot)
            cost = trajectory_costs([criterion], [trajectory], problem.world)[0, 0]
            if program.costs[0].exact:
                assert planned == pytest.approx(cost, rel=1e-9)
            else:
                assert planned >= cost - 1e-9
                above.append(planned - cost)
    assert not above or np.median(above) < 0.5
