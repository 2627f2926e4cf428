"""Speed profiles for a passenger: against an optimal control program in time, perturbations, and filters of scipy."""

from __future__ import annotations

from itertools import pairwise

import casadi
import numpy as np
import pytest
import shapely

import hpop
from hpop.criteria.comfort.sickness import W_D, W_F, W_K
from hpop.models.driven import driven
from hpop.motions import States
from hpop.planners.programs.weighted_profiles import FilterMatrices, WeightedMotion, WeightedProgram
from tests.iso_filters import motion_sickness

WORLD = hpop.World.from_polygons([], extent=shapely.box(-60, -60, 60, 60))
SEAT = (0.2, 0.1, 0.5)
ROBOT = hpop.DifferentialDrive(seat=SEAT, speed=2.0, acceleration=1.0, turn_rate=1.5, turn_acceleration=3.0)
CAR = hpop.Ackermann(wheelbase=1.6, seat=SEAT, speed=3.0, acceleration=1.0, steering_rate=0.25)
TINY = 1e-2  # share of a dose by which programs may miss a local minimum, for even accelerations
ROADS = {  # controls of `driven`: accelerations, m/s² and rad/s², for some seconds
    "straight": [(1.0, 0, 1.5), (0, 0, 4.0), (-1.0, 0, 1.5)],
    "bend": [(0.8, 0, 1.5), (0, 0.5, 0.8), (0, 0, 2.5), (0, -0.5, 0.8), (-0.8, 0, 1.5)],
    "s": [(0.8, 0, 1.5), (0, 0.5, 0.8), (0, 0, 1.5), (0, -0.5, 1.6), (0, 0, 1.5), (0, 0.5, 0.8), (-0.8, 0, 1.5)],
}
CAR_ROADS = {  # length, m, of each piece and curvature at its end, 1/m; the car begins straight ahead
    "bends of a car": [(6.0, 0.0), (4.0, 0.3), (3.0, 0.3), (5.0, -0.35), (4.0, 0.0), (5.0, 0.0)],
}


def problem_of(path):
    """Return the problem from the start of a trajectory to its end."""
    ends = [tuple(float(getattr(path.states, name)[i]) for name in ("x", "y", "yaw")) for i in (0, -1)]
    return hpop.Problem(WORLD, path.model, *ends, ["length"])


def bends_of(controls):
    """Return the distance, m, and the curvature, 1/m, at which each piece of a road ends; both are linear between.

    Roads turn only while the speed is constant.
    """
    way, speed, turn, places = 0.0, 0.0, 0.0, [(0.0, 0.0)]
    for acceleration, spin, lasts in controls:
        assert not acceleration * spin
        way += speed * lasts + 0.5 * acceleration * lasts**2
        speed, turn = speed + acceleration * lasts, turn + spin * lasts
        places.append((way, turn / speed if speed > 1e-9 else 0.0))
    return np.array(places).T


def optimal_control(road, limits, weight, pieces=120):
    """Minimise duration + weight * dose² in time, by multiple shooting; return the duration, s, and the dose, m/s^1.5.

    The acceleration is constant in equal intervals of time. The filter is that of the standard, from zeros and poles.

    road    distances, m, and the curvature there, 1/m, which is linear between them
    limits  returns values and their largest sizes from the speed, the acceleration, and the curvature and its slope
    """
    place, bend = road
    steep = np.array(
        [(b - a) / max(e - s, 1e-9) for (s, e), (a, b) in zip(pairwise(place), pairwise(bend), strict=True)]
    )

    def curvature(d):
        """Return curvature and its slope at a distance."""
        found, slope = casadi.MX(0), casadi.MX(0)
        for i in range(len(steep)):
            inside = casadi.if_else(casadi.logic_and(d >= place[i], d < place[i + 1]), 1.0, 0.0)
            found += inside * (bend[i] + steep[i] * (d - place[i]))
            slope += inside * steep[i]
        return found, slope

    A, B, C, D = (casadi.DM(matrix) for matrix in motion_sickness())
    n = A.size1()
    state, a = casadi.MX.sym("state", 2 + 2 * n + 1), casadi.MX.sym("a")
    d, v = state[0], state[1]
    k, slope = curvature(d)
    turn, spin = k * v, k * a + slope * v**2
    ahead, left = SEAT[:2]
    felt = [a - spin * left - turn**2 * ahead, v * turn + spin * ahead - turn**2 * left]
    rates, square = [v, a], 0.0
    for j, signal in enumerate(felt):
        x = state[2 + j * n : 2 + (j + 1) * n]
        rates.append(casadi.mtimes(A, x) + B * signal)
        square += (casadi.mtimes(C, x) + D * signal) ** 2
    rate = casadi.Function("rate", [state, a], [casadi.vertcat(*rates, square)])
    step = casadi.MX.sym("step")
    now = state
    for _ in range(2):
        h = 0.5 * step
        k1 = rate(now, a)
        k2 = rate(now + 0.5 * h * k1, a)
        k3 = rate(now + 0.5 * h * k2, a)
        k4 = rate(now + h * k3, a)
        now = now + h / 6.0 * (k1 + 2 * k2 + 2 * k3 + k4)
    advance = casadi.Function("advance", [state, a, step], [now])
    shares = casadi.Function(
        "shares", [state, a], [casadi.vertcat(*(value / most for value, most in limits(v, a, k, slope)))]
    )

    program = casadi.Opti()
    states, forces, duration = program.variable(state.numel(), pieces + 1), program.variable(pieces), program.variable()
    for i in range(pieces):
        program.subject_to(states[:, i + 1] == advance(states[:, i], forces[i], duration / pieces))
        program.subject_to(program.bounded(-1.0, shares(states[:, i], forces[i]), 1.0))
    program.subject_to(states[:, 0] == 0)
    program.subject_to(states[0, -1] == place[-1])
    program.subject_to(states[1, -1] == 0)
    program.subject_to(states[1, :] >= 0)
    program.subject_to(duration >= 1.0)
    program.minimize(duration + weight * states[-1, -1])
    share, lasts = np.linspace(0, 1, pieces + 1), 2.0 * place[-1]
    program.set_initial(states[0, :], place[-1] * share**2 * (3 - 2 * share))
    program.set_initial(states[1, :], place[-1] / lasts * 6 * share * (1 - share))
    program.set_initial(duration, lasts)
    program.solver("ipopt", {"print_time": False}, {"print_level": 0, "sb": "yes", "max_iter": 1000})
    solution = program.solve()
    return float(solution.value(duration)), float(np.sqrt(solution.value(states[-1, -1])))


def wheels(v, a, k, slope):
    """Return speeds and accelerations of both wheels of ROBOT, 0.2 m beside its axis, with their limits."""
    turn, spin = k * v, k * a + slope * v**2
    for side in (0.2, -0.2):
        yield v + side * turn, ROBOT.wheel_speed
        yield a + side * spin, ROBOT.wheel_acceleration


def steering(v, a, k, slope):
    """Return the speed, the acceleration, and the rate of the steering angle atan(L k) of CAR, with their limits."""
    yield v, CAR.speed
    yield a, CAR.acceleration
    yield CAR.wheelbase * slope * v / (1 + (CAR.wheelbase * k) ** 2), CAR.steering_rate


def on_clothoids(pieces):
    """Return the ride of CAR along a road, given by (length, curvature at the end) of its pieces, as clothoids."""
    knots, yaw, bend = [(0.0, 0.0, 0.0)], 0.0, 0.0
    for length, after in pieces:
        share = (np.arange(2000) + 0.5) / 2000
        heading = yaw + length * share * (bend + 0.5 * (after - bend) * share)
        step = length * np.cos(heading).mean(), length * np.sin(heading).mean()
        yaw, bend = yaw + 0.5 * length * (bend + after), after
        knots.append((knots[-1][0] + step[0], knots[-1][1] + step[1], yaw))
    columns = dict(zip(("x", "y", "yaw"), np.array(knots).T, strict=True))
    return hpop.Trajectory(CAR, States(**columns), ("clothoid",) * len(pieces))


@pytest.mark.proof
@pytest.mark.parametrize("road", [*ROADS, *CAR_ROADS])
def test_profiles_are_as_good_as_a_weighted_sweep_of_optimal_control_in_time(road):
    if road in ROADS:
        path, known, limits = driven(ROBOT, (0, 0, 0), ROADS[road]), bends_of(ROADS[road]), wheels
    else:
        pieces = np.array([(0.0, 0.0), *CAR_ROADS[road]])
        path, known, limits = on_clothoids(CAR_ROADS[road]), (np.cumsum(pieces[:, 0]), pieces[:, 1]), steering
    problem = problem_of(path)
    least = hpop.retime(problem, path, discomfort="felt_msdv", points=1).costs[0, 0]
    for weight in (3.0, 100.0):
        duration, dose = optimal_control(known, limits, weight)
        front = hpop.retime(problem, path, discomfort="felt_msdv", points=2, slowest=max(duration / least, 1.001))
        found, felt = front.costs[-1]
        assert found <= duration * 1.002
        assert felt <= dose * 1.02


@pytest.mark.parametrize("weighting", [W_D, W_F, W_K])
def test_the_states_of_a_filter_have_the_gains_of_its_weighting(weighting):
    f = FilterMatrices.of(weighting)
    for frequency in (0.05, 0.2, 1.0, 8.0, 60.0):
        s = 2j * np.pi * frequency
        gain = f.c @ np.linalg.solve(s * np.eye(len(f.a)) - f.a, f.b) + f.d
        assert abs(gain) == pytest.approx(weighting.gain(frequency), rel=1e-9)


def random_motion(seed):
    """Return the weighted acceleration on a random road, its limits, and a generator; it pauses once."""
    rng = np.random.default_rng(seed)
    n = 20
    steps = rng.uniform(0.2, 0.4, 2 * n)
    slopes = np.column_stack([rng.uniform(0.8, 1.2, 2 * n), 0.2 * rng.standard_normal(2 * n), np.zeros(2 * n)])
    bends = np.column_stack([np.zeros(2 * n), np.repeat(rng.uniform(-0.3, 0.3, 10), 4), np.zeros(2 * n)])
    first = np.concatenate([np.arange(n), n + 1 + np.arange(n)])
    pauses = np.where(np.arange(2 * n) == n, rng.uniform(0.5, 3.0), 0.0)
    caps = np.full(2 * n + 2, 2.0)
    caps[[0, n, n + 1, -1]] = 0.0
    limited = np.zeros((2 * n, caps.size))
    limited[np.arange(2 * n), first], limited[np.arange(2 * n), first + 1] = -0.5 / steps, 0.5 / steps
    return WeightedMotion(slopes, bends, steps, first, pauses, W_F), caps, limited, rng


def lasting(motion, b):
    """Return the duration of a profile, s, without pauses."""
    root = np.sqrt(b)
    return float((2.0 * motion.steps / (root[motion.first] + root[motion.first + 1])).sum())


@pytest.mark.seeds(1, of=50)
def test_no_small_change_of_a_profile_lowers_its_dose(seed):
    motion, caps, limited, rng = random_motion(seed)
    begin = np.minimum(caps, 0.15)
    duration = 1.1 * lasting(motion, begin)
    best = WeightedProgram(motion, caps, limited, motion.dose(begin)).improved(begin, duration)
    assert best is not None
    dose = motion.dose(best)
    assert dose < 0.9 * motion.dose(begin)
    assert lasting(motion, best) <= duration * (1 + 1e-6)
    for size in np.repeat([0.1, 0.01, 0.001], 10):
        knots = np.sort(rng.uniform(0, caps.size, 7))
        other = best * np.exp(size * np.interp(np.arange(caps.size), knots, rng.standard_normal(7)))
        other *= (lasting(motion, other) / duration) ** 2
        if (other > caps).any() or np.abs(limited @ other).max() > 1.0:
            continue
        assert motion.dose(other) >= dose * (1 - TINY)


def test_a_straight_ride_gets_gentler_with_time_than_by_unweighted_acceleration():
    path = hpop.Trajectory.from_poses(ROBOT, [(0, 0, 0), (4, 0, 0)])
    problem = hpop.Problem(WORLD, ROBOT, (0, 0, 0), (4, 0, 0), ["length", "felt_msdv"])
    front = hpop.retime(problem, path, discomfort="felt_msdv", points=2)
    assert "NOT VALID" not in front.certificate
    assert "better profiles may exist" in front.certificate
    unweighted = hpop.retime(problem, path, points=2)
    assert front.costs[-1, 0] == pytest.approx(unweighted.costs[-1, 0], rel=1e-3)
    assert front.costs[-1, 1] < 0.98 * unweighted[-1].reported["felt_msdv"]


@pytest.mark.proof
def test_the_dose_of_a_program_is_that_of_the_trajectory_pauses_included():
    path = hpop.Trajectory.from_poses(ROBOT, [(0, 0, 0), (6, 0, 0), (6, 5, 2)])
    front = hpop.retime(problem_of(path), path, discomfort="felt_msdv", points=3)
    assert "NOT VALID" not in front.certificate
    assert (np.diff(front.costs[:, 1]) < 0).all()


@pytest.mark.parametrize("pause", [0.0, 0.5, 6.0])
def test_a_pause_at_the_end_of_a_ride_counts_in_the_dose(pause):
    """The filter rings on while the robot stands; 6 s of it added half of the dose, which the program did not see."""
    ends = [(0, 0, 0), (4, 0, 0)]
    path = hpop.Trajectory.from_poses(ROBOT, ends)
    columns = {
        name: np.append(getattr(path.states, name), getattr(path.states, name)[-1]) for name in ("x", "y", "yaw")
    }
    clock = np.append(np.zeros(path.states.size), pause)
    path = hpop.Trajectory(ROBOT, States(**columns, clock=clock), (*path.kinds, "hold"))
    front = hpop.retime(problem_of(path), path, discomfort="felt_msdv", points=2)
    assert "NOT VALID" not in front.certificate
    assert front.costs[0, 0] == pytest.approx(4.0 + pause, rel=1e-6)


@pytest.mark.parametrize("rate", [0.25, 0.8])
def test_a_car_steers_within_its_rate_also_between_the_positions_of_the_grid(rate):
    """The steering angle is followed by differences over 20,000 instants, by the bicycle's formula alone."""
    car = hpop.Ackermann(seat=(0.4, 0.0, 0.6), speed=2.0, steering_rate=rate)
    knots, yaw, bend = [(0.0, 0.0, 0.0)], 0.0, 0.0
    for after in (0.5, 0.0, -0.5, 0.0):  # 1/m, after each 1.5 m
        share = (np.arange(2000) + 0.5) / 2000
        heading = yaw + 1.5 * share * (bend + 0.5 * (after - bend) * share)
        yaw, bend = yaw + 0.75 * (bend + after), after
        knots.append((knots[-1][0] + 1.5 * np.cos(heading).mean(), knots[-1][1] + 1.5 * np.sin(heading).mean(), yaw))
    columns = dict(zip(("x", "y", "yaw"), np.array(knots).T, strict=True))
    path = hpop.Trajectory(car, States(**columns), ("clothoid",) * 4)
    front = hpop.retime(problem_of(path), path, points=1)
    ride = front[0].trajectory
    times = np.linspace(0.0, ride.duration, 20_001)[1:-1]
    states, (rates, _) = ride.at(times), ride.rates(times)
    speed = rates.x * np.cos(states.yaw) + rates.y * np.sin(states.yaw)
    angle = np.arctan(car.wheelbase * rates.yaw / speed)
    steering = np.abs(np.diff(angle)) / np.diff(times)
    assert steering.max() <= rate * (1.0 + 1e-4)
    if rate < 0.5:
        assert steering.max() > 0.5 * rate  # it is what limits the speed
    assert not any("zones" in note for note in front.notes)  # the world has none
    assert any("faster than the limits of steering allow;" in note for note in front.notes) is (rate < 0.5)


def car_ride(*poses, **options):
    """Return the shortest ride of a car through poses."""
    car = hpop.Ackermann(seat=(0.4, 0.0, 0.6), speed=2.0, steering_rate=0.8, **options)
    states = States(**dict(zip(("x", "y", "yaw"), np.array(poses, float).T, strict=True)))
    return hpop.Trajectory.through(car, states)


@pytest.mark.parametrize(
    "poses", [pytest.param([(0, 0, 0), (3, 2, 1.0)], marks=pytest.mark.proof), [(0, 0, 0), (0.5, 1.0, np.pi)]]
)
def test_a_car_keeps_its_path_its_stops_and_its_limits_at_any_speed(poses):
    path = car_ride(*poses)
    run = path.execution()
    front = hpop.retime(problem_of(path), path, points=2)
    assert front.costs[0, 0] == pytest.approx(run.duration, rel=1e-6)
    line = shapely.LineString(np.column_stack([(at := run.at(np.linspace(0, run.duration, 5001))).x, at.y]))
    for point in front:
        made = point.trajectory
        assert not list(path.model.faults(made))
        at = made.at(np.linspace(0, made.duration, 501))
        assert shapely.distance(line, shapely.points(at.x, at.y)).max() < 1e-3
        assert (made.states.x[-1], made.states.y[-1]) == pytest.approx(poses[-1][:2])
    stands = [kind == "hold" for kind in run.kinds]
    assert made.durations[[kind == "hold" for kind in made.kinds]].sum() == pytest.approx(run.durations[stands].sum())


def test_a_passenger_needs_a_seat_and_no_limit_of_jerk():
    path = hpop.Trajectory.from_poses(ROBOT, [(0, 0, 0), (6, 0, 0)])
    with pytest.raises(hpop.errors.OptionError, match="jerk cannot be limited with the discomfort felt_msdv"):
        hpop.retime(problem_of(path), path, discomfort="felt_msdv", jerk=2.0)
    bare = hpop.Trajectory.from_poses(hpop.DifferentialDrive(), [(0, 0, 0), (6, 0, 0)])
    with pytest.raises(hpop.errors.CriterionError, match="requires seat"):
        hpop.retime(problem_of(bare), bare, discomfort="felt_msdv")
