"""However often a robot takes another way, what it drives has no jump: not in place, heading or speed."""

from __future__ import annotations

import numpy as np
import pytest
import shapely

import hpop
from hpop.errors import DriveError
from hpop.problems.verify import verify
from tests.drive.rooms import planned

SWITCHES = 10  # a seed
PACE = 1e-3  # s between the samples


def switched(seed: int) -> hpop.drive.Execution:
    """Return a drive that switches its option ten times, while areas close and open before it."""
    rng = np.random.default_rng(seed)
    problem, front = planned()
    drive = hpop.follow(problem, front, int(rng.integers(len(front))))
    now = taken = 0
    while taken < SWITCHES and not drive.at(now).arrived:
        try:
            if rng.random() < 0.3:
                at = rng.uniform((1.5, 0.5), (9.0, 5.5))
                drive.world(now, close=shapely.box(*at, *(at + rng.uniform(0.1, 1.0, 2))), name=f"{now}")
            elif drive.surroundings.closings:
                drive.world(now, open=drive.surroundings.closings[0].area)
        except DriveError as error:
            if "covers" not in str(error):
                raise
        options = drive.options(now, 0.05)
        if len(options):
            drive.take(int(rng.integers(len(options))))
            taken += 1
        now += rng.uniform(0.1, 2.0)
    while drive.surroundings.closings:
        drive.world(now, open=drive.surroundings.closings[0].area)
    return drive


@pytest.mark.seeds(1, of=55)
def test_nothing_that_is_driven_jumps(seed: int) -> None:
    drive = switched(seed)
    way = drive.plan
    # Each motion begins, to the last bit, where the one before it ends, and moves go where they look.
    moves = np.flatnonzero(np.array(way.kinds) == "move")
    dx, dy = (np.diff(column)[moves] for column in (way.states.x, way.states.y))
    yaw = way.states.yaw[moves]
    assert np.abs(np.cos(yaw) * dy - np.sin(yaw) * dx).max() < 1e-9
    assert (np.cos(yaw) * dx + np.sin(yaw) * dy > 0.0).all()
    # Between samples it moves no farther than the model's speeds allow: 1 m/s, 1.5 rad/s.
    times = np.arange(0.0, way.duration, PACE)
    states = way.at(times)
    assert np.hypot(np.diff(states.x), np.diff(states.y)).max() <= PACE + 1e-9
    assert np.abs(np.diff(states.yaw)).max() <= 1.5 * PACE + 1e-9
    # The speed is cruise speed along a move and none in a turn or a hold: it changes only where the law stops.
    speed = np.hypot(*(getattr(way.rates(0.5 * (way.times[:-1] + way.times[1:]))[0], name) for name in "xy"))
    assert speed == pytest.approx([1.0 if kind == "move" else 0.0 for kind in way.kinds], abs=1e-9)
    problem, _ = planned()
    assert not verify(problem, alone(problem, drive))


def alone(problem: hpop.Problem, drive: hpop.drive.Execution) -> hpop.Front:
    """Return the driven trajectory as a front of its own."""
    costs = problem.evaluate(drive.plan)
    names = [criterion.name for criterion in problem.criteria]
    return hpop.Front.of(
        [[costs[name] for name in names]],
        [drive.plan],
        names=names,
        units=[criterion.unit for criterion in problem.criteria],
        quanta=[criterion.quantum for criterion in problem.criteria],
        groups=[criterion.group for criterion in problem.criteria],
        problem=problem.describe(),
    )
