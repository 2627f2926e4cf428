"""Speed profiles of robots that carry a head or an arm: closed forms, limits on dense samples, and what stays."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
import shapely

import hpop
from hpop.motions import States
from hpop.problems.verify import verify
from hpop.trajectories.trajectory import Trajectory
from tests.models.serial_arm.arms import arm6

WORLD = hpop.World.from_polygons([], extent=shapely.box(-9, -9, 9, 9))
BASE = hpop.DifferentialDrive(radius=0.3, body_height=0.4)
HEAD = hpop.PanTilt(hpop.DifferentialDrive(radius=0.3), tilt_rate=0.7)
QUICK = hpop.PanTilt(hpop.DifferentialDrive(radius=0.3, speeds=(0.5, 1.2)), pan_rate=0.8)
MOBILE = hpop.MobileArm(arm6(base=(0, 0, 0.45, 0, 0, 0)), BASE)
SLOW = hpop.MobileArm(
    arm6(base=(0, 0, 0.45, 0, 0, 0), velocity_scaling=(0.5, 1.0)),
    hpop.DifferentialDrive(radius=0.3, body_height=0.4, speeds=(0.4, 1.0)),
)
ROBOTS = {"head": HEAD, "head of several speeds": QUICK, "mobile arm": MOBILE, "arm of several speeds": SLOW}
EVERY = pytest.mark.parametrize("robot", list(ROBOTS.values()), ids=list(ROBOTS))


def path(robot, seed, count=3):
    """Return a trajectory through random states, a chain of motions between each two."""
    rng, names = np.random.default_rng(seed), robot.space.names
    low, high = np.maximum(robot.space.low, -1.2), np.minimum(robot.space.high, 1.2)
    rows = rng.uniform(
        np.where(np.isfinite(low), low, -1.2), np.where(np.isfinite(high), high, 1.2), (count, len(names))
    )
    here = States(**dict(zip(names, rows[:1].T, strict=True)))
    states, kinds = [here], []
    for row in rows[1:]:
        for leg in robot.connect(here, States(**dict(zip(names, row[:, None], strict=True)))):
            if leg.present[0]:
                states.append(leg.end)
                kinds.append(leg.kind)
        here = states[-1]
    columns = {name: np.concatenate([getattr(each, name) for each in states]) for name in names}
    if not robot.speed_classes:
        return Trajectory(robot, States(**columns), tuple(kinds))
    speed, rows, done = [0.0], [0], []
    for i, kind in enumerate(kinds):
        moves = kind == "move"
        steps = [("speed_change", i, 0.5), ("move", i + 1, 0.5), ("speed_change", i + 1, 0.0)]
        for name, row, at in steps if moves else [(kind, i + 1, 0.0)]:
            done.append(name)
            rows.append(row)
            speed.append(at)
    states = States(**{n: c[rows] for n, c in columns.items()}, speed=np.array(speed))
    return Trajectory(robot, states, tuple(done))


def asked(trajectory, criteria=("length", "turns", "rotation"), **parts):
    names = trajectory.model.space.names
    ends = [tuple(float(getattr(trajectory.states, name)[i]) for name in names) for i in (0, -1)]
    return hpop.Problem(WORLD, trajectory.model, *ends, list(criteria), **parts)


def limits(robot):
    """Return largest speeds and accelerations by name of a state, from the parameters of the robot."""
    base = robot.base
    known = {"way": (base.speed, base.acceleration), "yaw": (base.turn_rate, base.turn_acceleration)}
    if isinstance(robot, hpop.PanTilt):
        pan, tilt = (robot.pan_rate, robot.pan_acceleration), (robot.tilt_rate, robot.tilt_acceleration)
        return known | {"pan": pan, "tilt": tilt}
    chain = robot.arm.chain
    return known | dict(zip(chain.names, zip(chain.speed, chain.acceleration, strict=True), strict=True))


def trapezoids(robot, run):
    """Return the seconds of the fastest motion from rest to rest through the states of a run.

    The robot also stops between two motions in one direction, which only reaches and turns have; these are joined.
    """
    names, known = robot.space.names, limits(robot)
    rows = np.column_stack([getattr(run.states, name) for name in names])
    changes = []
    for a, b in pairwise(rows):
        change = dict(zip(names, b - a, strict=True))
        change["way"] = np.hypot(change.pop("x"), change.pop("y"))
        change = np.array([change[name] for name in known])
        if not np.abs(change).max() > 1e-9:
            continue
        before = changes[-1] if changes else 0 * change
        lengths = np.linalg.norm(before), np.linalg.norm(change)
        joined = lengths[0] > 0 and np.abs(before / lengths[0] - change / lengths[1]).max() < 1e-9
        changes[len(changes) - joined :] = [before + change if joined else change]
    total = 0.0
    for change in np.abs(changes):
        rate = min(v / c for c, (v, _) in zip(change, known.values(), strict=True) if c > 1e-9)
        gain = min(a / c for c, (_, a) in zip(change, known.values(), strict=True) if c > 1e-9)
        total += 1 / rate + rate / gain if rate**2 < gain else 2 / np.sqrt(gain)
    return total


@EVERY
@pytest.mark.seeds(1, of=50)
def test_the_fastest_profile_is_that_of_trapezoids(robot, seed):
    taken = path(robot, seed)
    fastest = hpop.retime(asked(taken, ["rotation"]), taken, points=1)
    assert fastest.costs[0, 0] == pytest.approx(trapezoids(robot, taken.execution()), rel=1e-3)
    assert fastest.costs[0, 0] <= taken.execution().duration * (1 + 1e-6)


@pytest.mark.cases("0-head of several speeds")
@EVERY
@pytest.mark.seeds(1, of=20)
def test_dense_samples_keep_all_limits_and_the_path_stays(robot, seed):
    taken = path(robot, seed)
    taken = taken if seed % 2 else taken.with_hold(at=0, seconds=2.0)
    discomfort = ("squared_acceleration", "peak_optic_flow")[seed % 2]
    if discomfort == "peak_optic_flow":
        world = hpop.World.from_polygons([shapely.box(3, -3, 4, 3)], extent=shapely.box(-9, -9, 9, 9))
    else:
        world = WORLD
    names = robot.space.names
    ends = [tuple(float(getattr(taken.states, name)[i]) for name in names) for i in (0, -1)]
    problem = hpop.Problem(world, robot, *ends, ["length", "rotation"])
    front = hpop.retime(problem, taken, points=4, discomfort=discomfort)
    assert len(front) >= 3
    assert "NOT VALID" not in front.certificate
    assert verify(hpop.Problem.from_description(front.problem), front) == []
    before, run, step = problem.evaluate(taken.execution()), taken.execution(), 2e-3
    dense = run.at(np.linspace(0, run.duration, 4001))
    line = np.column_stack([getattr(dense, name) for name in names])
    for point in front:
        done = point.trajectory
        assert point.reported == pytest.approx(before, rel=1e-4)
        assert done.execution() is done
        at = done.at(np.arange(0.0, done.duration, step))
        columns = {"way": np.append(0.0, np.cumsum(np.hypot(np.diff(at.x), np.diff(at.y))))}
        for name, (speed, acceleration) in limits(robot).items():
            rate = np.diff(columns.get(name, getattr(at, name, None))) / step
            assert np.abs(rate).max() <= speed * (1 + 1e-6)
            assert np.abs(np.diff(rate)).max() <= acceleration * step * (1 + 1e-4)
        rows = np.column_stack([getattr(at, name) for name in names])[:: max(1, at.size // 60)]
        assert max(np.abs(line - row).max(axis=1).min() for row in rows) < 0.01
    assert (np.diff(front.costs[:, 1]) < 0).all()


def test_a_profile_that_is_too_fast_is_a_fault_and_jerk_is_limited():
    taken = path(HEAD, 3)
    made = hpop.retime(asked(taken), taken, points=1)[0].trajectory
    assert list(HEAD.faults(made)) == []
    for name, by in (("pace", 1.1),):
        columns = dict(made.states.__dict__)
        columns[name] = by * columns[name]
        faster = Trajectory(HEAD, States(**columns), made.kinds)
        assert any("is faster or speeds up harder" in fault for fault in HEAD.faults(faster))
    soft = hpop.retime(asked(taken), taken, points=1, jerk=4.0)
    assert soft.costs[0, 0] > made.duration


def test_a_tour_of_a_head_keeps_its_dwell_and_is_loaded_again(tmp_path):
    tour = {"stops": [{"at": [4, 1], "within": 0.5, "dwell": 3.0}]}
    problem = hpop.Problem(WORLD, HEAD, (0, 0, 0, 0, 0), (6, 2, None, None, None), ["duration", "turns"], tour=tour)
    plan = problem.solve("lattice", step=1.0).best("duration").trajectory
    front = hpop.retime(problem, plan, points=3)
    held = [np.diff(t.states.clock)[[kind == "hold" for kind in t.kinds]].sum() for t in front.trajectories]
    assert held == pytest.approx([3.0] * len(front))
    front.save(tmp_path / "front.json")
    again = hpop.Front.load(tmp_path / "front.json")
    assert np.array_equal(again.costs, front.costs)
    assert verify(hpop.Problem.from_description(again.problem), again) == []
