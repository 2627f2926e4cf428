"""One run of an RRT under wheel accelerations, by OMPL: from rest at the start to rest at the goal.

The tree (LaValle and Kuffner 2001, "Randomized kinodynamic planning") grows by drives of constant wheel accelerations
that are drawn at random; OMPL does the growing, :mod:`hpop.planners.rrt.query` says how the robot moves and what is
free. A state is at the goal if braking from it would end near the goal. That stop is added, and the gap that is left
is closed (:mod:`hpop.planners.rrt.close`).
"""

from __future__ import annotations

import math
import threading
from importlib import import_module
from time import time
from typing import Any, NamedTuple

import numpy as np

from hpop.base.arrays import FloatArray
from hpop.errors import OptionError
from hpop.planners.rrt.close import close
from hpop.planners.rrt.query import NEAR, STEP, Base, Query, of_wheels

MOST_STEPS = 5  # wheel accelerations are held for one to so many steps
LATE = "were ended by the time limit"
VELOCITIES = 0.5  # weight of differences in speed (m/s, rad/s) beside those in position (m), in the tree's distance

_alone = threading.Lock()  # OMPL's random numbers begin at a seed that the whole process shares


class TreeRun(NamedTuple):
    """What came of a run.

    controls    (n, 3)  accelerations, m/s² and rad/s², and duration, s, of each drive; none if it failed
    failure     why it failed, or ""
    extensions  of the tree, those that failed included
    missed      m, from the goal to the nearest place at which the tree could stop; 0 if it is near enough, and infinite
                if nothing is known
    """

    controls: FloatArray
    failure: str
    extensions: int
    missed: float = 0.0


def run(query: Query, seed: int) -> TreeRun:
    """Grow one tree; its outcome depends on the arguments alone, unless it is `LATE`."""
    if query.arrived:
        return TreeRun(np.empty((0, 3)), "", 0)
    with _alone:
        controls, extensions, missed = grow(query, seed)
    if controls is None:
        failure = "did not reach the goal" if extensions >= query.extensions else LATE
        return TreeRun(np.empty((0, 3)), failure, extensions, missed)
    closed = close(query, controls)
    if closed is None:
        return TreeRun(np.empty((0, 3)), "ended near the goal, from where it could not be led to it", extensions)
    return TreeRun(closed, "", extensions)


def load_ompl() -> tuple[Any, Any, Any]:
    """The modules base, control and util of OMPL; raises OptionError where it is not installed."""
    try:
        return import_module("ompl.base"), import_module("ompl.control"), import_module("ompl.util")
    except ImportError as error:
        raise OptionError(
            f"planner 'rrt' needs OMPL, the extra hpop[rrt] ({error}); pip install 'hpop[rrt]', or use another planner"
        ) from None


def grow(query: Query, seed: int) -> tuple[FloatArray | None, int, float]:
    """Controls (n, 3) from the start to rest near the goal, or None, the number of extensions, and the gap left, m."""
    ob, oc, util = load_ompl()
    level = util.getLogLevel()
    util.setLogLevel(util.LOG_NONE)
    try:
        util.RNG.setSeed(seed)
        space = oc.SpaceInformation(*_spaces(query, ob, oc))
        space.setStatePropagator(lambda *arguments: _propagate(query, *arguments))
        space.setStateValidityChecker(lambda state: state[1][0] >= 0.0)
        space.setPropagationStepSize(STEP)
        space.setMinMaxControlDuration(1, MOST_STEPS)
        space.setup()
        definition = ob.ProblemDefinition(space)
        start = space.allocState()
        _write(start, Base(*query.start, 0.0, 0.0))
        definition.addStartState(start)
        definition.setGoal(_goal(query, ob, space))
        tree = oc.RRT(space)
        tree.setProblemDefinition(definition)
        tree.setup()
        extensions = 0

        def enough() -> bool:
            nonlocal extensions
            if query.until is not None and time() >= query.until:
                return True
            extensions += 1
            return extensions > query.extensions

        tree.solve(ob.PlannerTerminationCondition(enough))
        if not definition.hasExactSolution():
            missed = NEAR * float(definition.getSolutionDifference()) if definition.hasSolution() else math.inf
            return None, min(extensions, query.extensions), missed
        return _controls(query, definition.getSolutionPath()), extensions, 0.0
    finally:
        util.setLogLevel(level)


def _spaces(query: Query, ob: Any, oc: Any) -> tuple[Any, Any]:
    """States, places with velocities, and controls, the accelerations of the left and the right wheel."""
    limits, (x_min, y_min, x_max, y_max) = query.limits, query.world.bounds

    def bounds(*ranges: tuple[float, float]) -> Any:
        box = ob.RealVectorBounds(len(ranges))
        for i, (low, high) in enumerate(ranges):
            box.setLow(i, low)
            box.setHigh(i, high)
        return box

    places, velocities, states = ob.SE2StateSpace(), ob.RealVectorStateSpace(2), ob.CompoundStateSpace()
    places.setBounds(bounds((x_min, x_max), (y_min, y_max)))
    velocities.setBounds(bounds((0.0, limits.speed), (-limits.turn_rate, limits.turn_rate)))
    states.addSubspace(places, 1.0)
    states.addSubspace(velocities, VELOCITIES)
    controls = oc.RealVectorControlSpace(states, 2)
    wheel = (-limits.wheel_acceleration, limits.wheel_acceleration)
    controls.setBounds(bounds(wheel, wheel))
    return states, controls


def _goal(query: Query, ob: Any, space: Any) -> Any:
    """The goal region, and the goal at rest, towards which every twentieth extension goes."""

    class Goal(ob.GoalSampleableRegion):  # type: ignore[misc]
        def distanceGoal(self, state: Any) -> float:  # noqa: N802  (OMPL's name)
            return query.distance(_read(state))

        def sampleGoal(self, state: Any) -> None:  # noqa: N802
            x, y, yaw = query.goal
            bearing = math.atan2(y - query.start[1], x - query.start[0])
            _write(state, Base(x, y, bearing if yaw is None else yaw, 0.0, 0.0))

        def maxSampleCount(self) -> int:  # noqa: N802
            return 1

    goal = Goal(space)
    goal.setThreshold(1.0)
    return goal


def _propagate(query: Query, state: Any, control: Any, duration: float, result: Any) -> None:
    """Write where a drive ends; one that must not be driven ends at a speed below 0, which is valid to no one."""
    base = _read(state)
    end = query.drive(base, *of_wheels(query.model, control[0], control[1]), duration)
    _write(result, base._replace(speed=-1.0) if end is None else end)


def _read(state: Any) -> Base:
    place, velocity = state[0], state[1]
    return Base(place.getX(), place.getY(), place.getYaw(), velocity[0], velocity[1])


def _write(state: Any, base: Base) -> None:
    place, velocity = state[0], state[1]
    place.setXY(base.x, base.y)
    place.setYaw(math.remainder(base.yaw, 2.0 * math.pi))
    velocity[0], velocity[1] = base.speed, base.turn_rate


def _controls(query: Query, path: Any) -> FloatArray:
    """Controls (n, 3) of a path of OMPL's, a row a step, and of the stop at its end."""
    rows = []
    for i in range(path.getControlCount()):
        wheels = path.getControl(i)
        steps = round(path.getControlDuration(i) / STEP)
        rows += [(*of_wheels(query.model, wheels[0], wheels[1]), STEP)] * steps
    last = _read(path.getState(path.getStateCount() - 1))
    return np.concatenate([np.array(rows).reshape(-1, 3), query.braking(last)])
