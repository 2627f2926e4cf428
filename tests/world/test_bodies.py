"""Claims: a solid is its prism in the plane and itself in space; what prisms and cells make solid is solid there."""

import json
import math
import pickle
from dataclasses import replace

import fcl
import numpy as np
import pytest
import shapely

import hpop
from hpop.errors import MapError
from hpop.motions import States
from hpop.problems.problem import Problem
from hpop.testing.worlds import in_frame, reframed
from hpop.world import Box, Cylinder, Ground, Hull, Obstacle, Solid, Sphere, World, pose_at
from hpop.world import bodies as made_bodies
from hpop.world.bodies import ENDLESS, convex_pieces
from hpop.world.content.content import Person, Zone
from hpop.world.geometry.solids import SAGITTA

HALL = shapely.box(0, 0, 6, 4)
CORNER = shapely.Polygon([(0, 0), (2, 0), (2, 1), (1, 1), (1, 3), (0, 3)])
FRAME = shapely.box(0, 0, 5, 4).difference(shapely.box(1, 1, 4, 3))
COMB = shapely.union_all([shapely.box(0, 0, 9, 1), *(shapely.box(i, 1, i + 0.5, 3) for i in range(0, 9, 2))])
TABLE, SHELF = Box((1.0, 1.5, 0.75)), Box((0.5, 2.0, 0.25))
GIVEN = (
    Solid(TABLE, pose_at((2.5, 0.75, 0.375)), "table"),
    Solid(SHELF, pose_at((4.25, 3.0, 1.125)), "shelf"),
)
WRITTEN = [(shapely.box(2.0, 0.0, 3.0, 1.5), (0.0, 0.75)), (shapely.box(4.0, 2.0, 4.5, 4.0), (1.0, 1.25))]


def volume(solid):
    shape = solid.shape
    return float(np.prod(shape.size)) if isinstance(shape, Box) else shape.volume


def collision_object(solid):
    """Return a body for python-fcl."""
    match solid.shape:
        case Box(size):
            geometry = fcl.Box(*size)
        case Cylinder(radius, length):
            geometry = fcl.Cylinder(radius, length)
        case Sphere(radius):
            geometry = fcl.Sphere(radius)
        case Hull() as hull:
            faces = np.concatenate([[3, *triangle] for triangle in hull.triangles])
            geometry = fcl.Convex(hull.points, len(hull.triangles), faces)
    return fcl.CollisionObject(geometry, fcl.Transform(solid.pose[:3, :3], solid.pose[:3, 3]))


def apart(one, other):
    return fcl.distance(collision_object(one), collision_object(other))


def test_a_box_on_the_floor_is_the_same_obstacle_as_a_polygon_with_a_height():
    solid, written = World.from_solids(GIVEN, extent=HALL), World.from_polygons(WRITTEN, extent=HALL)
    x, y = np.random.default_rng(0).uniform((0, 0), (6, 4), (300, 2)).T
    for z in ((-math.inf, math.inf), (0.0, 0.5), (0.8, 1.2), (1.3, 2.0)):
        np.testing.assert_array_equal(solid.clearance(x, y, z=z), written.clearance(x, y, z=z))
    np.testing.assert_array_equal(solid.clearance_field().values, written.clearance_field().values)
    fields = [world.obstruction_field(1.0, 1.0).values for world in (solid, written)]
    np.testing.assert_allclose(*fields, atol=1e-12)
    robot = hpop.DifferentialDrive(radius=0.3, camera_height=1.2)
    fronts = [
        Problem(world, robot, (0.5, 0.5, 0), (5.5, 0.5, None), ["obstruction", "turns", "length"]).solve(
            "lattice", step=0.5
        )
        for world in (solid, written)
    ]
    assert fronts[0].costs.size
    np.testing.assert_allclose(fronts[0].costs, fronts[1].costs, rtol=1e-12)
    states = States(x=x, y=y, yaw=0 * x)
    judged = robot.judge(solid).states_free(states)
    assert 0 < judged.sum() < judged.size
    np.testing.assert_array_equal(judged, robot.judge(written).states_free(states))


def test_the_bodies_of_both_are_the_same_boxes():
    for one, other in zip(World.from_solids(GIVEN).bodies, World.from_polygons(WRITTEN).bodies, strict=True):
        np.testing.assert_allclose(one.bounds, other.bounds, atol=1e-12)
        assert isinstance(other.shape, Box)
    assert World.from_solids(GIVEN).bodies == GIVEN


@pytest.mark.parametrize("radius", [0.03, 0.4])
def test_a_cylinder_is_never_farther_than_it_is_and_nearer_by_no_more_than_the_sagitta(radius):
    world = World.from_solids(
        [Solid(Cylinder(radius, 1.0), pose_at((3.0, 2.0, 0.5)))], extent=shapely.box(-9, -9, 19, 19)
    )
    x, y = np.random.default_rng(0).uniform((1, 0), (5, 4), (500, 2)).T
    true = np.hypot(x - 3.0, y - 2.0) - radius
    found = world.clearance(x, y)
    assert (found <= np.maximum(true, 0.0) + 1e-12).all()
    assert (found >= true - SAGITTA).all()


def test_what_is_not_upright_is_the_prism_round_it_in_the_plane_and_noted_once():
    leaning = Solid(Box((0.2, 0.2, 2.0)), pose_at((3.0, 2.0, 1.0), rpy=(0.5, 0, 0)), "ladder")
    ball = Solid(Sphere(0.5), pose_at((1.0, 1.0, 0.5)))
    world = World.from_solids([*GIVEN, leaning, ball], extent=HALL)
    (note,) = world.notes
    assert "2 of 4 (ladder, solid 3)" in note
    assert [body.name for body in world.bodies] == ["table", "shelf", "ladder", "solid 3"]
    assert "each counts as the upright prism" in note
    assert replace(world, keep_out=shapely.box(0, 0, 0.5, 0.5)).notes == (note,)
    assert World.from_description(world.describe()).notes == (note,)
    low, high = 2.0 - math.sin(0.5) - 0.1 * math.cos(0.5), 2.0 + math.sin(0.5) + 0.1 * math.cos(0.5)
    assert world.obstacles[2].polygon.bounds == pytest.approx((2.9, low, 3.1, high))
    assert not World.from_solids(GIVEN).notes


def test_solids_stay_what_they_are_when_a_world_is_saved_sent_furnished_or_changed():
    hull = Solid(Hull([(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)]), pose_at((3, 2, 0), rpy=(0, 0, 1 / 3)), "wedge")
    can = Solid(Cylinder(0.3, 1.0), pose_at((1, 1, 0.5)), "can")
    pillar = Obstacle(shapely.box(5, 3, 5.5, 3.5), 0.0, 2.0)
    world = World(Ground((pillar,), extent=HALL, solids=(hull, can, *GIVEN)))
    described = json.loads(json.dumps(world.describe()))
    built = World.from_description(described)
    sent = pickle.loads(pickle.dumps(world))
    furnished = world.with_content(people=[Person(1, 3)])
    changed = replace(world, ground=replace(world.ground, extent=shapely.box(0, 0, 7, 7)))
    for other in (built, sent, furnished, changed):
        assert [solid.describe() for solid in other.ground.solids] == [
            solid.describe() for solid in world.ground.solids
        ]
        assert len(other.obstacles) == 5
        assert len(other.ground.bodies) == 5
    assert built.describe() == described == json.loads(json.dumps(sent.describe()))
    assert "obstacles: 1, solids: 4" in repr(world)
    emptied = replace(world.ground, obstacles=(pillar,))
    assert emptied.solids == world.ground.solids


def test_the_same_world_in_another_frame_has_its_solids_there():
    leaning = Solid(Cylinder(0.2, 1.0), pose_at((1.0, 3.0, 0.6), rpy=(0.3, 0.2, 0.1)))
    world = World.from_solids([*GIVEN, leaning], extent=HALL)
    x, y = np.random.default_rng(0).uniform((0, 0), (6, 4), (100, 2)).T
    other = reframed(world)
    np.testing.assert_allclose(other.clearance(*in_frame(x, y)), world.clearance(x, y), atol=2 * SAGITTA)
    assert [body.heights for body in other.bodies] == [body.heights for body in world.bodies]
    assert apart(*other.bodies[1:]) == pytest.approx(apart(*world.bodies[1:]), abs=1e-6)


def test_worlds_without_solids_are_described_as_ever():
    assert "solids" not in World.from_polygons(WRITTEN).describe()


def test_distances_between_bodies_are_those_of_geometry():
    ball = Solid(Sphere(0.5), pose_at((0, 0, 3)))
    lying = Solid(Cylinder(0.25, 2.0), pose_at((0, 2, 0), rpy=(0, math.pi / 2, 0)))
    world = World(
        Ground(
            (
                Obstacle(shapely.box(4, -1, 6, 1), 0.0, 2.0),
                Obstacle(shapely.Polygon([(-4, 0), (-3, 1), (-5, 1)]), 0, 2),
            ),
            extent=shapely.box(-9, -9, 9, 9),
            solids=(ball, lying, Solid(Box((1, 1, 1)), pose_at((0, -3, 0), rpy=(0, 0, math.pi / 4)))),
        )
    )
    block, wedge, ball, lying, turned = world.bodies
    assert apart(ball, lying) == pytest.approx(math.hypot(2, 3) - 0.75, abs=1e-4)
    assert apart(block, ball) == pytest.approx(math.hypot(4, 1) - 0.5, abs=1e-4)
    assert apart(lying, turned) == pytest.approx(5 - 0.25 - math.sqrt(0.5), abs=1e-4)
    assert apart(block, wedge) == pytest.approx(4 + 3, abs=1e-4)
    assert isinstance(wedge.shape, Hull)
    assert isinstance(block.shape, Box)


@pytest.mark.parametrize(
    "polygon", [CORNER, FRAME, COMB, shapely.Point(0, 0).buffer(1), shapely.affinity.rotate(FRAME, 33)]
)
def test_convex_pieces_are_convex_disjoint_and_together_the_polygon(polygon):
    pieces = convex_pieces(polygon)
    assert all(piece.convex_hull.area == pytest.approx(piece.area) for piece in pieces)
    assert sum(piece.area for piece in pieces) == pytest.approx(polygon.area, rel=1e-9)
    assert shapely.union_all(pieces).symmetric_difference(polygon).area < 1e-9
    assert len(pieces) <= len(polygon.exterior.coords)
    world = World.from_polygons([(polygon, (0.5, 1.5))])
    assert sum(volume(body) for body in world.bodies) == pytest.approx(polygon.area, rel=1e-9)
    assert all(body.heights == pytest.approx((0.5, 1.5)) for body in world.bodies)
    assert {body.name for body in world.bodies} == {"obstacle 0"}


@pytest.mark.parametrize(
    ("heights", "cut"),
    [
        ((-math.inf, math.inf), (-ENDLESS, ENDLESS)),
        ((0.5, math.inf), (0.5, 0.5 + ENDLESS)),
        ((30.0, math.inf), (30.0, 30.0 + ENDLESS)),
        ((-math.inf, 2.0), (-ENDLESS, 2.0)),
        ((-math.inf, -20.0), (-20.0 - ENDLESS, -20.0)),
        ((12.0, 90.0), (12.0, 90.0)),
    ],
)
def test_what_has_no_end_is_cut_where_the_docs_say(heights, cut):
    (body,) = World.from_polygons([(shapely.box(0, 0, 1, 1), heights)]).bodies
    assert body.heights == pytest.approx(cut)


def test_slivers_are_solid():
    sliver = shapely.Polygon([(0, 0), (3, 0), (3, 1e-9)])
    (body,) = World.from_polygons([(sliver, (0.0, 1e-8))], extent=HALL).bodies
    low, high = body.bounds
    assert (low <= (0, 0, 0)).all()
    assert (high >= (3, 1e-9, 1e-8)).all()


@pytest.mark.parametrize("yaw", [0.0, 0.6])
def test_cells_are_boxes_that_cover_them_and_nothing_else(yaw):
    cells = np.random.default_rng(3).random((12, 9)) < 0.5
    world = World.from_cells(cells, 0.5, origin=(1.0, 2.0, yaw), height=(0.0, 2.0))
    assert sum(volume(body) for body in world.bodies) == pytest.approx(cells.sum() * 0.25 * 2.0)
    together = shapely.union_all([body.outline for body in world.bodies])
    assert together.symmetric_difference(world.solid()).area < 1e-9
    walls = np.zeros((40, 30), dtype=bool)
    walls[:, [0, 29]] = walls[[0, 39]] = True
    assert len(World.from_cells(walls, 0.5).bodies) == 4
    assert World.from_cells(~walls & walls, 0.5).bodies == ()


def test_too_many_bodies_are_refused_with_their_number(monkeypatch):
    cells = np.zeros((200, 200), dtype=bool)
    cells[::2, ::2] = True
    with pytest.raises(
        MapError, match=r"the cells of this world make 10,000 convex bodies.*at most 5,000.*larger cells"
    ):
        _ = World.from_cells(cells, 0.1).bodies
    monkeypatch.setattr(made_bodies, "MOST_BODIES", 3)
    with pytest.raises(MapError, match="the obstacles of this world make"):
        _ = World.from_polygons([COMB]).bodies
    with pytest.raises(MapError, match="the keep-out zones of this world make"):
        _ = World.from_polygons([], extent=HALL, keep_out=COMB).bodies


def test_people_who_stand_and_keep_out_zones_are_closed_in_space_but_nothing_solid():
    world = World.from_solids(GIVEN, extent=HALL).with_content(
        people=[Person(1, 3, radius=0.3, name="Ada"), Person(1, 1, velocity=(0.5, 0)), Person(5, 3.5)],
        zones=[Zone("keep-out", CORNER, name="rail"), Zone("speed", HALL, limit=0.5)],
    )
    world = replace(world, keep_out=shapely.box(5, 0, 6, 1))
    assert world.ground.bodies == GIVEN
    closed = world.bodies[2:]
    assert [body.name for body in closed] == ["Ada", "person 2", "keep-out zone", "rail", "rail"]
    assert all(body.heights == pytest.approx((-ENDLESS, ENDLESS)) for body in closed)
    assert closed[0].shape == Cylinder(0.3, 2 * ENDLESS)
    outlines = shapely.union_all([body.outline for body in closed])
    assert outlines.symmetric_difference(world.closed).area < 0.01


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: World.from_solids([]), "needs an extent: give the area"),
        (lambda: World.from_solids([Box((1, 1, 1))]), r"a list of hpop\.world\.Solid, each a shape with its pose"),
        (lambda: World.from_solids(GIVEN, extent=shapely.Polygon()), "extent is empty"),
        (lambda: World.from_solids(GIVEN, extent="room"), "extent must be a valid shapely Polygon"),
        (lambda: World.from_solids([GIVEN[0]] * 5001), "at most 5,000 solids"),
        (lambda: Ground(solids="box", extent=HALL), "solids must be a list"),
        (lambda: Obstacle(HALL, 0, 1, "box"), r"must be a hpop\.world\.Solid"),
        (lambda: World.from_description(DESCRIBED | {"solids": [{"box": [1, 1, 1], "name": "a"}]}), "malformed"),
        (lambda: World.from_description(DESCRIBED | {"solids": [{"cone": 1, "pose": [], "name": ""}]}), "malformed"),
        (lambda: World.from_description(DESCRIBED | {"solids": 3}), "malformed"),
        (
            lambda: World.from_description(DESCRIBED | {"solids": [GIVEN[0].describe() | {"box": [1, 2, -3]}]}),
            "a box's size",
        ),
    ],
)
def test_what_is_no_world_of_solids_is_refused(make, message):
    with pytest.raises(MapError, match=message):
        make()


DESCRIBED = World.from_polygons(WRITTEN).describe()
