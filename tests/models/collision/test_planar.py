"""Planar collision against python-fcl in space and against shapely by brute force."""

import numpy as np
import pytest
import shapely
import shapely.affinity
from hypothesis import given
from hypothesis import strategies as st

from hpop.models import DifferentialDrive
from hpop.motions import Motions, States
from hpop.planners.spending import Spending
from hpop.runtime import limits
from hpop.runtime.limits import Budget
from hpop.world import World

L_SHAPE = ((0.5, 0.2), (-0.2, 0.2), (-0.2, -0.6), (0.1, -0.6), (0.1, -0.2), (0.5, -0.2))
LONG = ((0.7, 0.1), (-0.3, 0.1), (-0.3, -0.1), (0.7, -0.1))
ROBOTS = {
    "round": DifferentialDrive(radius=0.3),
    "camera ahead": DifferentialDrive(radius=0.2, camera_offset=(0.35, -0.1)),
    "long": DifferentialDrive(footprint=LONG),
    "not convex": DifferentialDrive(footprint=L_SHAPE, camera_offset=(-0.1, -0.5)),
}
robots = pytest.mark.parametrize("robot", ROBOTS.values(), ids=ROBOTS.keys())
NEAR = 1e-5  # m: what touches within this may be called either way


def room(seed):
    """Return a room with boxes at all heights, triangles on the floor, tables, lamps and a keep-out zone."""
    rng = np.random.default_rng(seed)
    obstacles = []
    for _ in range(7):
        corner, size = rng.uniform(0.3, 5.0, 2), rng.uniform(0.1, 1.2, 2)
        heights = [(0.0, 2.0), (0.0, 0.2), (0.6, 0.8), (1.5, 2.0), (-np.inf, np.inf)][rng.integers(5)]
        obstacles.append((shapely.box(*corner, *(corner + size)), heights))
    for _ in range(3):
        obstacles.append(shapely.Polygon(rng.uniform(0, 6, 2) + rng.uniform(-0.8, 0.8, (3, 2))))
    return World.from_polygons(obstacles, extent=shapely.box(0, 0, 6, 6), keep_out=shapely.box(2.0, 5.0, 2.6, 6.0))


def random_states(seed, size):
    rng = np.random.default_rng(seed)
    return States(x=rng.uniform(-0.3, 6.3, size), y=rng.uniform(-0.3, 6.3, size), yaw=rng.uniform(-np.pi, np.pi, size))


def outline(robot, part_number, x, y, yaw):
    """One prism of the robot in a state, made from its parameters, not from its parts: (shape, z range)."""
    cos, sin = np.cos(yaw), np.sin(yaw)

    def placed(points):
        return [(x + cos * a - sin * b, y + sin * a + cos * b) for a, b in points]

    if part_number == 1:
        return shapely.Point(placed([robot.camera_offset])[0]), robot.mast_radius, (0.0, robot.camera_height)
    if robot.footprint is None:
        return shapely.Point(x, y), robot.radius, (0.0, robot.body_height)
    return shapely.Polygon(placed(robot.footprint)), 0.0, (0.0, robot.body_height)


def margin(robot, world, x, y, yaw):
    """Signed gap, m, between robot and world by shapely distances: positive when free, negative when it collides."""
    gap = np.inf
    for number in (0, 1):
        shape, grown, (z_min, z_max) = outline(robot, number, x, y, yaw)
        blocked = [world.keep_out]
        blocked += [o.polygon for o in world.obstacles if o.z_min < z_max and o.z_max > z_min]
        gap = min([gap, *(shape.distance(b) - grown for b in blocked)])
        border = shape.distance(world.extent.exterior) - grown
        gap = min(gap, border if world.extent.contains(shape) else -1.0)
        if grown == 0.0:  # the distance of overlapping shapes is 0, so tell how deep they are by their area
            gap = min([gap, *(-shape.intersection(b).area for b in blocked if shape.intersects(b))])
    return gap


def free_by_shapely(robot, world, states):
    gaps = np.array([margin(robot, world, *s) for s in zip(states.x, states.y, states.yaw, strict=True)])
    return gaps > 0, np.abs(gaps) > NEAR


@robots
@pytest.mark.seeds(1, of=3)
def test_states_are_free_where_shapely_and_fcl_say_so(robot, seed):
    world, states = room(seed), random_states(seed + 50, 400)
    free = robot.collision(world).states_free(states)
    expected, sure = free_by_shapely(robot, world, states)
    assert 0.05 < free.mean() < 0.95
    assert sure.mean() > 0.95
    assert (free == expected)[sure].all()
    assert (robot.judge(world).states_free(states) == expected)[sure].all()


@robots
@pytest.mark.seeds(1, of=3)
def test_a_clear_position_is_free_at_every_yaw(robot, seed):
    world, states = room(seed), random_states(seed + 80, 300)
    collision = robot.collision(world)
    clear = collision.clear(states.x, states.y)
    assert clear.any()
    for yaw in np.linspace(-np.pi, np.pi, 13):
        turned = States(x=states.x, y=states.y, yaw=np.full(states.size, yaw))
        free = collision.states_free(turned)
        assert free[clear].all()
        if not collision.yaw_matters:
            assert (free == clear).all()
    assert collision.yaw_matters == (robot is not ROBOTS["round"])


@pytest.mark.cases("0-100-move-not convex", "0-100-run-long")
@robots
@pytest.mark.seeds(1, of=3)
@pytest.mark.parametrize("kind", ["move", "run"])
@pytest.mark.parametrize("count", [100, pytest.param(150, marks=pytest.mark.proof)])
def test_moves_are_free_exactly_where_dense_samples_are(robot, seed, kind, count):
    world, start = room(seed), random_states(seed + 20, count)
    length = np.random.default_rng(seed).uniform(0.0, 1.0, count)
    end = States(x=start.x + length * np.cos(start.yaw), y=start.y + length * np.sin(start.yaw), yaw=start.yaw)
    collision = robot.collision(world)
    free = collision.motions_free(Motions(world, robot, robot.laws[kind], start, end))
    assert 0.05 < free.mean() < 0.95
    sampled = np.ones(count, dtype=bool)
    for share in np.linspace(0, 1, 201):
        between = States(**{n: (1 - share) * getattr(start, n) + share * getattr(end, n) for n in start.names})
        sampled &= collision.states_free(between)
    assert not (free & ~sampled).any()  # never too lenient
    # What samples do not find collides by less than a sample's spacing: a robot that much smaller is free of it.
    for i in np.flatnonzero(sampled & ~free):
        ends = (np.array([one.x[i], one.y[i], one.yaw[i]]) for one in (start, end))
        assert any(margin(robot, world, *pose) < 0.005 for pose in np.linspace(*ends, 201))


@pytest.mark.cases("0-100-turn-not convex", "0-100-spin-long")
@robots
@pytest.mark.seeds(1, of=3)
@pytest.mark.parametrize("kind", ["turn", "spin"])
@pytest.mark.parametrize("count", [100, pytest.param(200, marks=pytest.mark.proof)])
def test_turns_never_miss_a_collision_that_dense_samples_find(robot, seed, kind, count):
    world, start = room(seed), random_states(seed + 30, count)
    turn = np.random.default_rng(seed).uniform(-np.pi, np.pi, count)
    end = States(x=start.x, y=start.y, yaw=start.yaw + turn)
    collision = robot.collision(world)
    free = collision.motions_free(Motions(world, robot, robot.laws[kind], start, end))
    assert 0.03 < free.mean() < 0.95
    sampled = np.ones(count, dtype=bool)
    for share in np.linspace(0, 1, 301):
        sampled &= collision.states_free(States(x=start.x, y=start.y, yaw=start.yaw + share * turn))
    assert not (free & ~sampled).any()
    # What is refused though samples are free is nearer to something than the stated excess of the hulls.
    excess = 0.045 * max(part.reach for part in robot.parts)
    for i in np.flatnonzero(sampled & ~free):
        yaws = start.yaw[i] + turn[i] * np.linspace(0, 1, 301)
        assert any(margin(robot, world, start.x[i], start.y[i], yaw) < excess + 0.005 for yaw in yaws)


def state(x, y, yaw=0.0):
    return States(x=np.array([x]), y=np.array([y]), yaw=np.array([yaw]))


def is_free(robot, world, x, y, yaw=0.0):
    answers = {
        bool(robot.collision(world).states_free(state(x, y, yaw))[0]),
        bool(robot.judge(world).states_free(state(x, y, yaw))[0]),
    }
    assert len(answers) == 1
    return answers.pop()


def test_a_robot_passes_under_a_high_table_but_its_camera_mast_does_not():
    table = (shapely.box(4, 4, 6, 6), (0.7, 0.8))
    world = World.from_polygons([table], extent=shapely.box(0, 0, 10, 10))
    assert is_free(DifferentialDrive(body_height=0.4, camera_height=0.6), world, 5, 5)
    assert not is_free(DifferentialDrive(body_height=0.4, camera_height=1.2), world, 5, 5)
    assert not is_free(DifferentialDrive(body_height=0.75, camera_height=0.6), world, 5, 5)
    tall = DifferentialDrive(radius=0.3, body_height=0.4, camera_height=1.2, camera_offset=(-0.25, 0.0))
    assert is_free(tall, world, 4.1, 5)  # its mast is at 3.85, its body below the table
    assert not is_free(tall, world, 4.1, 5, np.pi)
    low = World.from_polygons([(shapely.box(4, 4, 6, 6), (0.0, 0.1))], extent=shapely.box(0, 0, 10, 10))
    assert not is_free(tall, low, 4.1, 5)


def test_prisms_that_share_only_a_height_do_not_collide():
    shelf = (shapely.box(4, 4, 6, 6), (0.4, 3.0))
    world = World.from_polygons([shelf], extent=shapely.box(0, 0, 10, 10))
    assert is_free(DifferentialDrive(body_height=0.4, camera_height=0.4), world, 5, 5)


def test_the_border_of_the_extent_and_keep_out_zones_stop_every_part():
    world = World.from_polygons([], extent=shapely.box(0, 0, 10, 10), keep_out=shapely.box(4, 4, 6, 6))
    robot = DifferentialDrive(radius=0.3, camera_offset=(0.5, 0.0))
    assert is_free(robot, world, 2, 2)
    assert not is_free(robot, world, 0.2, 2, 0.0)
    assert not is_free(robot, world, 3.8, 5, np.pi)
    assert is_free(robot, world, 0.4, 2, 0.0)
    assert not is_free(robot, world, 0.4, 2, np.pi)  # the mast is outside
    for far in (-0.4, -2.0, -500.0):
        assert not is_free(robot, world, far, 5)


@given(st.floats(0.05, 1.0), st.floats(-3.0, 3.0))
def test_discs_may_touch(radius, y):
    wall = shapely.box(5, -10, 6, 10)
    world = World.from_polygons([wall], extent=shapely.box(-10, -10, 10, 10))
    robot = DifferentialDrive(radius=radius)
    collision = robot.collision(world)
    for gap, expected in ((0.0, True), (1e-6, True), (-1e-6, False)):
        x = 5 - radius - gap
        assert collision.states_free(state(x, y))[0] == expected
        assert collision.clear(np.array([x]), np.array([y]))[0] == expected
        move = Motions(world, robot, robot.laws["move"], state(x, y, np.pi / 2), state(x, y + 2, np.pi / 2))
        assert collision.motions_free(move)[0] == expected


def test_a_thin_wall_between_two_free_ends_stops_a_move_of_any_robot():
    world = World.from_polygons([shapely.box(5, 0, 5.001, 10)], extent=shapely.box(0, 0, 10, 10))
    for robot in ROBOTS.values():
        move = Motions(world, robot, robot.laws["move"], state(3, 5), state(7, 5))
        assert not robot.collision(world).motions_free(move)[0]


def test_a_pillar_between_the_ends_of_a_half_turn_stops_it():
    world = World.from_polygons([shapely.box(4.99, 5.5, 5.01, 5.6)], extent=shapely.box(0, 0, 10, 10))
    robot = ROBOTS["long"]
    collision = robot.collision(world)
    for turn, expected in ((np.pi, False), (-np.pi, True)):
        motion = Motions(world, robot, robot.laws["turn"], state(5, 5, 0.0), state(5, 5, turn))
        assert collision.motions_free(motion)[0] == expected


def test_the_bulge_of_an_arc_between_two_outlines_is_not_missed():
    robot = DifferentialDrive(radius=0.2, camera_offset=(0.5, 0.0), mast_radius=0.05)
    turn = np.radians(4.99)
    # A pin that the mast's circle (0.55 m) covers half way through the turn, but not the hull of its two ends.
    near, far = 0.5 * np.cos(turn / 2) + 0.05 + 1e-4, 0.6
    assert near < 0.55 - 1e-4
    pin = shapely.LineString([(near, 0), (far, 0)]).buffer(1e-6, cap_style="flat")
    pin = shapely.affinity.rotate(pin, turn / 2, origin=(0, 0), use_radians=True)
    world = World.from_polygons([pin], extent=shapely.box(-2, -2, 2, 2))
    collision = robot.collision(world)
    assert collision.states_free(state(0, 0, 0.0))[0]
    assert collision.states_free(state(0, 0, turn))[0]
    assert not collision.states_free(state(0, 0, turn / 2))[0]
    motion = Motions(world, robot, robot.laws["turn"], state(0, 0, 0.0), state(0, 0, turn))
    assert not collision.motions_free(motion)[0]


def test_no_states_and_no_motions_are_no_trouble():
    world, nothing = room(0), random_states(0, 0)
    for robot in ROBOTS.values():
        collision = robot.collision(world)
        assert collision.states_free(nothing).shape == (0,)
        for law in robot.laws.values():
            none = States(**dict.fromkeys((*nothing.names, *getattr(law, "extra", ())), nothing.x))
            assert collision.motions_free(Motions(world, robot, law, none, none)).shape == (0,)


@pytest.mark.parametrize(
    ("x", "y", "text"),
    [
        (2.0, 2.0, ""),
        (-1.0, 2.0, "outside the map, which spans x 0.00 to 10.00 m, y 0.00 to 8.00 m"),
        (5.0, 5.0, "inside an obstacle"),
        (8.5, 1.0, "in a keep-out zone"),
        (3.9, 5.0, "is 0.100 m away and the robot reaches 0.300 m"),
        (0.2, 4.0, "is 0.200 m away and the robot reaches 0.300 m"),
    ],
)
def test_why_blocked_names_the_reason(x, y, text):
    world = World.from_polygons(
        [shapely.box(4, 4, 6, 6)], extent=shapely.box(0, 0, 10, 8), keep_out=shapely.box(8, 0, 9, 2)
    )
    reason = DifferentialDrive(radius=0.3).collision(world).why_blocked(state(x, y))
    assert text in reason
    assert bool(reason) == bool(text)


def test_why_blocked_speaks_of_the_part_that_is_blocked():
    table, stump = shapely.box(4, 4, 6, 6), shapely.box(3.5, 5.1, 3.7, 5.3)
    world = World.from_polygons([(table, (0.7, 0.8)), (stump, (0.0, 0.2))], extent=shapely.box(0, 0, 10, 10))
    # The body is below the table but 0.2 m from the stump; the mast stands free at x = 3.85.
    robot = DifferentialDrive(radius=0.3, camera_offset=(-0.25, 0.0))
    distance = np.hypot(4.1 - 3.7, 5.1 - 5.0)
    assert robot.collision(world).why_blocked(state(4.1, 5.0)) == ""
    assert distance > 0.3
    wide = DifferentialDrive(radius=0.45, camera_offset=(-0.25, 0.0))
    reason = wide.collision(world).why_blocked(state(4.1, 5.0))
    assert f"is {distance:.3f} m away and the robot reaches 0.450 m" in reason
    assert "inside an obstacle" in DifferentialDrive().collision(world).why_blocked(state(5.0, 5.0))


def test_long_moves_are_free_where_what_they_sweep_is_free():
    rng = np.random.default_rng(8)
    boxes = [shapely.box(*corner, *(corner + rng.uniform(0.2, 2.0, 2))) for corner in rng.uniform(3, 57, (25, 2))]
    world, robot = World.from_polygons(boxes, extent=shapely.box(0, 0, 60, 60)), DifferentialDrive(radius=0.3)
    ends = rng.uniform(0.5, 59.5, (2, 200, 2))
    yaw = np.arctan2(*(ends[1] - ends[0]).T[::-1])
    start, end = (States(x=x, y=y, yaw=yaw) for x, y in (end.T for end in ends))
    free = robot.collision(world).motions_free(Motions(world, robot, robot.laws["move"], start, end))
    gap = shapely.distance(shapely.linestrings(ends.transpose(1, 0, 2)), shapely.unary_union(boxes))
    assert (np.abs(gap - 0.3) > NEAR).all()
    assert (free == (gap > 0.3)).all()
    assert 20 < free.sum() < 180


def test_a_check_of_many_moves_looks_at_the_limits():
    world, robot = World.from_polygons([], extent=shapely.box(0, 0, 60, 60)), DifferentialDrive(radius=0.3)
    start, end = (States(x=np.array([x]), y=np.array([1.0]), yaw=np.zeros(1)) for x in (1.0, 59.0))
    motions = Motions(world, robot, robot.laws["move"], start, end)
    assert robot.collision(world).motions_free(motions).all()
    with limits.within(Spending(Budget(time_limit=1e-9))), pytest.raises(limits.LimitPassed):
        robot.collision(world).motions_free(motions)
