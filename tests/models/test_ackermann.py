"""Tests of the car-like base: laws against Fresnel integrals, shortest paths against brute force, and limits."""

from __future__ import annotations

import math
from collections.abc import Iterator
from itertools import product

import numpy as np
import pytest
import shapely
from scipy.special import fresnel

import hpop
from hpop.errors import ModelError
from hpop.models.ackermann.laws import clothoid_shape
from hpop.models.ackermann.words import LETTERS, composed, dubins, reeds_shepp
from hpop.motions import States
from hpop.testing import check_model
from hpop.trajectories.trajectory import Trajectory

CAR = hpop.Ackermann(wheelbase=2.0, steering=0.5, steering_rate=0.5, speed=2.0, reverse_speed=1.0)


def poses(*rows: tuple[float, float, float]) -> States:
    return States(**dict(zip(("x", "y", "yaw"), np.array(rows, float).T, strict=True)))


def random_poses(size: int, reach: float = 5.0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    rng = np.random.default_rng(40)
    return rng.uniform(-reach, reach, size), rng.uniform(-reach, reach, size), rng.uniform(-np.pi, np.pi, size)


def fresnel_point(sharpness: float, length: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the point of a clothoid from the origin with curvature ``sharpness`` times the length, by scipy."""
    scale = math.sqrt(math.pi / abs(sharpness))
    sine, cosine = fresnel(length / scale)
    return scale * cosine, math.copysign(scale, sharpness) * sine


@pytest.mark.parametrize(("sharpness", "length"), [(0.1, 3.0), (-0.4, 2.0), (0.02, 8.0), (1.5, 1.2)])
@pytest.mark.parametrize("backwards", [False, True])
def test_a_clothoid_is_the_fresnel_integral(sharpness, length, backwards):
    """Euler's spiral from a straight start, also when it is driven from its curved end back to the origin."""
    law, turn = CAR.laws["clothoid"], 0.5 * sharpness * length**2
    x, y = fresnel_point(sharpness, np.array([length]))
    ends = poses((0, 0, 0)), poses((x[0], y[0], turn))
    start, end = ends[::-1] if backwards else ends
    shape = law.shape(start, end)
    assert shape.length[0] == pytest.approx(-length if backwards else length, abs=1e-11)
    assert shape.curvature(0.0 if backwards else 1.0)[0] == pytest.approx(sharpness * length, abs=1e-10)
    assert shape.curvature(1.0 if backwards else 0.0)[0] == pytest.approx(0.0, abs=1e-10)
    for share in (0.25, 0.6, 1.0):
        at = fresnel_point(sharpness, np.array([length * share]))
        there = 1.0 - share if backwards else share
        for name, expected in zip("xy", at, strict=True):
            assert law.interpolate(name, start, end, np.array([there])) == pytest.approx(expected, abs=1e-11)


def test_a_clothoid_between_ends_of_an_arc_is_that_arc():
    ends = poses((1, 2, 0.3)), poses((3.0, 3.5, 0.3 + 2 * (math.atan2(1.5, 2.0) - 0.3)))
    arc, spiral = CAR.laws["arc"].shape(*ends), CAR.laws["clothoid"].shape(*ends)
    assert spiral.length == pytest.approx(arc.length, abs=1e-12)
    assert abs(spiral.bend[0]) < 1e-12


@pytest.mark.parametrize("kind", ["arc", "clothoid"])
def test_derivatives_of_a_curve_are_those_of_its_states(kind):
    law, share, by = CAR.laws[kind], np.array([0.37]), 1e-5
    turn = 0.8 if kind == "clothoid" else 2 * math.atan2(0.5, 2.0) - 2 * 0.1
    start, end = poses((0, 0, 0.1)), poses((2.0, 0.5, 0.1 + turn))
    for name in ("x", "y", "yaw"):
        before, here, after = (law.interpolate(name, start, end, share + k * by) for k in (-1, 0, 1))
        first, second = law.slopes(name, start, end, share)
        assert first == pytest.approx((after - before) / (2 * by), abs=1e-8)
        assert second == pytest.approx((after - 2 * here + before) / by**2, abs=1e-4)


def test_a_clothoid_that_newton_does_not_find_is_refused():
    """A pose beside the start, in the opposite heading, is the end of no short spiral."""
    assert not np.isfinite(CAR.laws["clothoid"].strays(poses((0, 0, 0)), poses((0.0, 0.0, 4.0))))[0]


@pytest.mark.parametrize("shortest", [dubins, reeds_shepp])
def test_words_end_in_the_wanted_poses(shortest):
    x, y, yaw = random_poses(2000)
    word = shortest(x, y, yaw)
    ends = [column[:, -1] for column in composed(word.curvature, word.length)]
    assert ends[0] == pytest.approx(x, abs=1e-9)
    assert ends[1] == pytest.approx(y, abs=1e-9)
    assert np.abs(np.angle(np.exp(1j * (ends[2] - yaw)))).max() < 1e-9
    assert (word.length >= 0).all() == (shortest is dubins)


def test_known_shortest_paths():
    """A straight move; half a circle; parallel parking; a turn on the spot by three arcs of 60 degrees."""
    x, y, yaw = (np.array(column) for column in ([3.0, 0.0, 0.0], [0.0, 2.0, 0.0], [0.0, np.pi, np.pi]))
    assert reeds_shepp(x, y, yaw).total == pytest.approx([3.0, np.pi, np.pi])
    assert dubins(x, y, yaw).total[:2] == pytest.approx([3.0, np.pi])
    assert dubins(x, y, yaw).total[2] == pytest.approx(7 * np.pi / 3)


def test_reeds_and_shepp_are_symmetric_and_never_longer_than_dubins():
    x, y, yaw = random_poses(2000)
    there = reeds_shepp(x, y, yaw).total
    back = reeds_shepp(-x * np.cos(yaw) - y * np.sin(yaw), x * np.sin(yaw) - y * np.cos(yaw), -yaw).total
    assert there == pytest.approx(back, abs=1e-9)
    assert (there <= dubins(x, y, yaw).total + 1e-9).all()
    assert (there >= np.hypot(x, y) - 1e-9).all()


def patterns(forwards: bool) -> Iterator[tuple[str, np.ndarray, np.ndarray]]:
    """Yield letters, and how the lengths of a word follow from three unknowns: lengths = unknowns @ gains + fixed."""
    for letters in ("LSL", "LSR", "RSL", "RSR", "LRL", "RLR"):
        yield letters, np.eye(3), np.zeros(3)
    if forwards:
        return
    quarter = 0.5 * np.pi
    for first, second in ("LR", "RL"):
        for sign in (1.0, -1.0):
            yield 2 * (first + second), np.array([[1, 0, 0, 0], [0, 1, sign, 0], [0, 0, 0, 1.0]]), np.zeros(4)
            for last in "LR":
                gains = np.array([[1, 0, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1.0]])
                yield first + second + "S" + last, gains, np.array([0, sign * quarter, 0, 0])
                yield last + "S" + second + first, gains[:, ::-1], np.array([0, 0, sign * quarter, 0])
                for other in (1.0, -1.0):
                    gains = np.array([[1, 0, 0, 0, 0], [0, 0, 1, 0, 0], [0, 0, 0, 0, 1.0]])
                    end = last + ("R" if last == "L" else "L")
                    yield first + second + "S" + end, gains, np.array([0, sign * quarter, 0, other * quarter, 0])


def shortest_by_enumeration(pose: tuple[float, float, float], forwards: bool, starts: int) -> float:
    """Return the length of the shortest word to a pose: Newton's method from a grid of starts, for every pattern."""
    least = np.inf
    grid = np.linspace(0.0 if forwards else -6.0, 6.0, starts)
    for letters, gains, fixed in patterns(forwards):
        bends = np.array([LETTERS[letter] for letter in letters])

        def miss(w: np.ndarray, bends=bends, gains=gains, fixed=fixed) -> np.ndarray:
            ways = w @ gains + fixed
            x, y, yaw = (column[:, -1] for column in composed(np.broadcast_to(bends, ways.shape), ways))
            return np.stack([x - pose[0], y - pose[1], np.remainder(yaw - pose[2] + np.pi, 2 * np.pi) - np.pi], axis=1)

        w = np.array(list(product(grid, repeat=3)))
        for _ in range(25):
            here = miss(w)
            slopes = np.stack([(miss(w + 1e-7 * unit) - here) / 1e-7 for unit in np.eye(3)], axis=2)
            turned = slopes.transpose(0, 2, 1)
            step = np.linalg.solve(turned @ slopes + 1e-12 * np.eye(3), turned @ here[..., None])[..., 0]
            w = w - step * np.minimum(1.0, 1.0 / np.maximum(np.abs(step).max(axis=1, keepdims=True), 1e-12))
        ways = w @ gains + fixed
        arcs = np.remainder(ways, 2 * np.pi)
        turns = np.where(bends == 0, ways, arcs if forwards else np.minimum(arcs, 2 * np.pi - arcs))
        found = np.abs(miss(w)).max(axis=1) < 1e-8
        if forwards:
            found &= (ways[:, bends == 0] >= -1e-9).all(axis=1)
        least = min(least, np.abs(turns[found]).sum(axis=1).min(initial=np.inf))
    return least


@pytest.mark.parametrize("forwards", [True, pytest.param(False, marks=pytest.mark.proof)])
@pytest.mark.parametrize("seed", [0, *(pytest.param(seed, marks=pytest.mark.proof) for seed in range(1, 13))])
def test_shortest_paths_are_those_of_an_enumeration(forwards, seed):
    rng = np.random.default_rng(seed)
    x, y, yaw = (np.array([value]) for value in rng.uniform((-3, -3, -np.pi), (3, 3, np.pi)))
    ours = (dubins if forwards else reeds_shepp)(x, y, yaw).total[0]
    least = shortest_by_enumeration((x[0], y[0], yaw[0]), forwards, 6)
    assert ours == pytest.approx(least, abs=1e-6)


@pytest.mark.parametrize("car", [CAR, hpop.Ackermann(reverse_speed=0.0)], ids=["reverses", "forwards"])
def test_a_goal_of_free_heading_takes_a_short_way(car):
    """No path to a free heading is longer than that to the heading of the chord."""
    x, y, yaw = random_poses(50)
    a, b = States(x=0 * x, y=0 * y, yaw=yaw), States(x=x, y=y, yaw=np.full(50, np.nan))
    legs = car.connect(a, b)
    assert np.isfinite(legs[-1].end.yaw).all()
    assert legs[-1].end.x == pytest.approx(x, abs=1e-9)
    same = States(x=x, y=y, yaw=yaw)
    assert (car.path(a, b).total <= car.path(a, same).total + 1e-9).all()


def test_a_plan_steers_while_it_stands_and_its_execution_stops_where_it_reverses():
    ends = poses((0, 0, 0), (0.0, 6.0, math.pi))
    plan = Trajectory.through(CAR, ends)
    done = plan.execution()
    assert set(plan.kinds) == {"arc"}
    assert "hold" in done.kinds
    assert done.duration <= plan.duration + 1e-9
    times = np.linspace(0, done.duration, 400)
    rates, changes = done.rates(times)
    speed = np.hypot(rates.x, rates.y)
    assert speed.max() <= CAR.speed + 1e-9
    assert np.abs(rates.yaw).max() <= CAR.speed / CAR.radius + 1e-9
    states = done.at(times)
    assert np.abs(rates.y * np.cos(states.yaw) - rates.x * np.sin(states.yaw)).max() < 1e-9  # no sliding
    along = changes.x * np.cos(states.yaw) + changes.y * np.sin(states.yaw)
    assert np.abs(along).max() <= CAR.acceleration + 1e-9


def test_without_a_steering_rate_arcs_join_without_stops():
    free = hpop.Ackermann(steering_rate=None, reverse_speed=0.0)
    plan = Trajectory.through(free, poses((0, 0, 0), (5.0, 3.0, 0.5)))
    done = plan.execution()
    assert "hold" not in done.kinds
    assert plan.duration == pytest.approx(free.radius * free.path(*(plan.states.take([i]) for i in (0, -1))).total[0])
    assert done.duration == pytest.approx(plan.duration + free.speed / free.acceleration)


def test_with_a_steering_rate_it_may_not_be_infinite_in_motion():
    done = Trajectory.through(hpop.Ackermann(steering_rate=None), poses((0, 0, 0), (5.0, 3.0, 0.5))).execution()
    names = {name: getattr(done.states, name) for name in done.states.names}
    slow = Trajectory(hpop.Ackermann(), States(**names), done.kinds)
    assert any("steering angle jumps" in fault for fault in slow.model.faults(slow))


@pytest.mark.parametrize(
    ("end", "fault"),
    [
        ((1.0, 1.0, math.pi / 2), "bends more sharply"),
        ((-1.0, 0.0, 0.0), "goes backwards"),
    ],
)
def test_faults_name_motions_beyond_the_limits(end, fault):
    car = hpop.Ackermann(wheelbase=2.0, steering=0.5, reverse_speed=0.0)
    wrong = Trajectory(car, poses((0, 0, 0), end), ("arc",))
    assert any(fault in text for text in car.faults(wrong))


def test_a_clothoid_too_sharp_for_the_steering_rate_is_a_fault():
    x, y = fresnel_point(0.2, np.array([1.0]))
    motion = Trajectory(CAR, poses((0, 0, 0), (x[0], y[0], 0.1)), ("clothoid",))
    needed = CAR.wheelbase * 0.2 * CAR.speed
    assert needed > CAR.steering_rate
    assert any("steers faster" in text for text in CAR.faults(motion))
    able = hpop.Ackermann(wheelbase=2.0, steering=0.5, steering_rate=needed * 1.001, speed=2.0)
    assert not list(able.faults(Trajectory(able, motion.states, motion.kinds)))


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"steering": 1.6}, "steering must be"),
        ({"steering": 34}, "34 degrees are 0.593 rad, in a scenario '34 deg'"),
        ({"wheelbase": 0}, "wheelbase must be"),
        ({"reverse_speed": 3.0}, "reverse_speed must be"),
        ({"steering_rate": 0}, "steering_rate must be"),
        ({"footprint": [(1, 1), (2, 1), (2, 2)]}, "footprint must contain"),
    ],
)
def test_wrong_options_are_named(options, said):
    with pytest.raises(ModelError, match=said):
        hpop.Ackermann(**options)


@pytest.mark.proof
@pytest.mark.parametrize(
    "car",
    [CAR, hpop.Ackermann(reverse_speed=0.0), hpop.Ackermann(steering_rate=None, camera_offset=(0.3, 0.2))],
    ids=["large", "forwards", "at once"],
)
def test_cars_follow_the_rules_of_models(car):
    for seed in range(3):
        check_model(car, rng=seed)


def test_the_shape_of_many_clothoids_reproduces_their_ends():
    """Spirals with random curvatures at both ends, integrated with 2,000 steps."""
    size, steps, rng = 40, 2000, np.random.default_rng(0)
    begin, stop, length = rng.uniform(-0.5, 0.5, size), rng.uniform(-0.5, 0.5, size), rng.uniform(0.3, 2.5, size)
    share = (np.arange(steps) + 0.5) / steps
    yaw = length[:, None] * (begin[:, None] * share + 0.5 * (stop - begin)[:, None] * share**2)
    x, y = (length * function(yaw).mean(axis=1) for function in (np.cos, np.sin))
    end = States(x=x, y=y, yaw=0.5 * length * (begin + stop))
    shape = clothoid_shape(States(x=0 * x, y=0 * x, yaw=0 * x), end)
    assert shape.length == pytest.approx(length, abs=1e-5)
    assert shape.curvature(0.0) == pytest.approx(begin, abs=1e-4)
    assert shape.curvature(1.0) == pytest.approx(stop, abs=1e-4)


@pytest.mark.proof
def test_without_limits_of_steering_shortest_paths_are_those_of_a_differential_drive():
    """As the wheelbase falls and the wheels steer at once, links approach straight lines."""
    wall = hpop.World.from_polygons([shapely.box(4, 0, 4.4, 5)], extent=shapely.box(0, 0, 10, 8))
    disc = [(0.2 * math.cos(a), 0.2 * math.sin(a)) for a in np.linspace(0, 2 * math.pi, 16, endpoint=False)]
    base = hpop.DifferentialDrive(radius=0.2, speed=1.0)
    ends = (1.0, 1.0, 0.0), (9.0, 1.0, None)
    known = hpop.Problem(wall, base, *ends, ["length"]).solve({"any-angle": {"step": 0.25}}).costs[0, 0]
    found = []
    for wheelbase in (0.4, 0.004):
        car = hpop.Ackermann(wheelbase=wheelbase, steering=1.0, steering_rate=None, reverse_speed=1.0, footprint=disc)
        front = hpop.Problem(wall, car, *ends, ["length"]).solve({"roadmap": {"samples": 400}})
        found.append(front.costs[0, 0] / known)
    assert found[1] < found[0]
    assert 0.99 < found[1] < 1.06


@pytest.mark.parametrize("length", [1.1e-6, 1.5e-6, 1e-5, 1e-3, 0.1])
def test_a_run_of_any_length_is_executed_from_rest_to_rest(length):
    """One of 1.1 micrometres, the last piece of a shortest path, divided by a speed of 0."""
    car = hpop.Ackermann(acceleration=1.0)
    states = States(x=np.array([0.0, 1.0, 1.0 - length]), y=np.zeros(3), yaw=np.zeros(3))
    executed = hpop.Trajectory(car, states, ("arc", "arc")).execution()
    forwards = 2.0 * 1.0  # 1 m from rest to rest at 1 m/s²
    assert executed.duration == pytest.approx(forwards + 2.0 * np.sqrt(length))


@pytest.mark.parametrize("pause", [0.0, 0.1, 5.0])
def test_a_car_steers_while_it_waits_and_no_faster(pause):
    """A left arc, a pause, then a right arc: a short pause shortened the execution by the time of steering."""
    car = hpop.Ackermann(steering_rate=0.8)
    turn = 1.0 / car.radius  # of an arc of 1 m
    x, y = np.sin(turn) * car.radius, (1.0 - np.cos(turn)) * car.radius
    columns = {"x": [0.0, x, x, 2 * x], "y": [0.0, y, y, 2 * y], "yaw": [0.0, turn, turn, 0.0]}
    columns["clock"] = [0.0, 0.0, pause, pause]
    states = States(**{name: np.array(column) for name, column in columns.items()})
    executed = hpop.Trajectory(car, states, ("arc", "hold", "arc")).execution()
    driving, straight, across = 2.0 * 2.0, car.steering / 0.8, 2.0 * car.steering / 0.8
    assert executed.duration == pytest.approx(driving + straight + max(pause, across))


def test_a_motion_of_length_0_hides_no_reversal():
    """Forwards 1 m, a motion without a length, 1 m back: two runs from rest to rest."""
    states = poses((0, 0, 0), (1, 0, 0), (1, 0, 0), (0, 0, 0))
    car = hpop.Ackermann(speed=1.0, reverse_speed=0.5, acceleration=1.0)
    executed = hpop.Trajectory(car, states, ("arc",) * 3).execution()
    assert executed.duration == pytest.approx(2.0 + (1.0 / 0.5 + 0.5))  # the second one cruises at 0.5 m/s
    assert not list(car.faults(executed))


@pytest.mark.parametrize("robot", [hpop.Ackermann, hpop.DifferentialDrive])
@pytest.mark.parametrize(("seat", "noted"), [((0.1, 0.1, 0.5), False), ((0.1, 1.5, 0.5), True)])
def test_a_seat_beside_the_footprint_is_remarked_on(robot, seat, noted):
    assert any("outside the robot's footprint" in note for note in robot(seat=seat).notes) == noted


def test_a_front_is_said_to_leave_out_stops_only_if_a_plan_reverses():
    world = hpop.World.from_polygons([], extent=shapely.box(-8, -8, 8, 8))
    car = hpop.Ackermann(seat=(0.4, 0.0, 0.6))
    fronts = {}
    for name, goal in (("ahead", (3.0, 0.0, 0.0)), ("back", (-1.0, 1.0, 0.0))):
        problem = hpop.Problem(world, car, (0, 0, 0), goal, ["duration"])
        fronts[name] = problem.solve({"exact": {"on": "primitives"}})
    fronts["retimed"] = hpop.retime(problem, fronts["back"][0].trajectory, points=1)
    said = {name: any("leave out stops" in note for note in front.notes) for name, front in fronts.items()}
    assert said == {"ahead": False, "back": True, "retimed": False}
