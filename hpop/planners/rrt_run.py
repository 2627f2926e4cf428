"""One run of an RRT under wheel accelerations, by OMPL: from rest at the start to rest at the goal.

The tree (LaValle and Kuffner 2001, "Randomized kinodynamic planning") grows by drives of constant wheel accelerations
that are drawn at random; OMPL does the growing, what is said here is how the robot moves and what is free. A state is
at the goal if braking from it would end near the goal. That stop is added, and the gap that is left is closed by
the least change of the last wheel accelerations.
"""

from __future__ import annotations

import math
import threading
from dataclasses import dataclass
from functools import cached_property
from importlib import import_module
from typing import TYPE_CHECKING, Any, NamedTuple, TypeVar

import numpy as np

from hpop.arrays import FloatArray
from hpop.errors import OptionError
from hpop.math import wrap
from hpop.models.collision import PlanarCollision
from hpop.models.driven import NODES, ahead, driven
from hpop.motions import States
from hpop.trajectory import Trajectory

if TYPE_CHECKING:
    from hpop.models import DifferentialDrive
    from hpop.world import World
    from hpop.world.planar import FreeSpace

STEP = 0.4  # s: wheel accelerations are constant for so long
MOST_STEPS = 5  # and are held for one to so many steps
NEAR, NEAR_YAW = 0.8, 0.3  # m, rad: from the goal to where braking ends; the rest is closed
SHARE = 0.95  # of each limit is used by the tree; the rest is for closing
VELOCITIES = 0.5  # weight of differences in speed (m/s, rad/s) beside those in position (m), in the tree's distance
SHARES = np.array([0.25, 0.5, 0.75, 1.0])  # of a drive, where its clearance is looked at
CLOSED = 1e-9  # m, rad, m/s, rad/s
LEAST_CHANGED = 16  # drives
NEWTON = 12  # steps; from such gaps four to six suffice
SLOPE = 1e-6  # m/s²: difference by which slopes are taken; Newton's method corrects for what they are off

T = TypeVar("T", float, FloatArray)

_at, _weight = (np.array(column) for column in zip(*NODES, strict=True))
_TIMES = SHARES[:, None] * _at  # (4, nodes) shares of the drive at which its velocity is summed up to each of SHARES

_alone = threading.Lock()  # OMPL's random numbers begin at a seed that the whole process shares


class Limits(NamedTuple):
    """What the wheels and the base keep.

    Wheels that accelerate by no more than this neither accelerate nor turn the base by more than the model allows; they
    reach the speeds that its runs and spins need.
    """

    speed: float  # m/s, of the base; it never goes back
    turn_rate: float  # rad/s
    wheel_speed: float  # m/s
    wheel_acceleration: float  # m/s²

    @classmethod
    def of(cls, model: DifferentialDrive) -> Limits:
        """The limits that follow from a model's."""
        half = 0.5 * model.wheel_base
        return cls(
            model.speed,
            model.turn_rate,
            max(model.speed, model.turn_rate * half),
            min(model.acceleration, model.turn_acceleration * half),
        )


class Run(NamedTuple):
    """What came of a run.

    controls    (n, 3)  accelerations, m/s² and rad/s², and duration, s, of each drive; none if it failed
    failure     why it failed, or ""
    extensions  of the tree, those that failed included
    """

    controls: FloatArray
    failure: str
    extensions: int


class Base(NamedTuple):
    """A state: m, m, rad, m/s and rad/s."""

    x: float
    y: float
    yaw: float
    speed: float
    turn_rate: float


@dataclass(frozen=True, eq=False)
class Query:
    """What all runs share; picklable.

    start       (x m, y m, yaw rad)
    goal        (x m, y m, yaw rad); a yaw of None is free
    extensions  of a tree before a run gives up
    """

    model: DifferentialDrive
    world: World
    start: tuple[float, float, float]
    goal: tuple[float, float, float | None]
    extensions: int

    @cached_property
    def limits(self) -> Limits:
        """Limits of the robot."""
        return Limits.of(self.model)

    @property
    def arrived(self) -> bool:
        """Whether the start is the goal."""
        turn = 0.0 if self.goal[2] is None else float(wrap(self.goal[2] - self.start[2]))
        return self.start[:2] == self.goal[:2] and turn == 0.0

    def trajectory(self, controls: FloatArray) -> Trajectory:
        """The trajectory from the start of some drives, or of none."""
        if not len(controls):
            return Trajectory.from_poses(self.model, [self.start])
        return driven(self.model, self.start, controls.tolist())

    @cached_property
    def spaces(self) -> tuple[tuple[FreeSpace, float], ...]:
        """The free space of each part of the robot, and the radius, m, of the circle that the part sweeps."""
        return tuple((self.world.free_space((part.z_min, part.z_max)), part.reach) for part in self.model.parts)

    def clear(self, x: FloatArray, y: FloatArray, margin: float) -> bool:
        """Whether the circles that the robot's parts sweep about positions (P,) have a margin, m."""
        return all(bool((space.clearance(x, y) >= reach + margin).all()) for space, reach in self.spaces)

    def drive(self, base: Base, acceleration: float, turn_acceleration: float, duration: float) -> Base | None:
        """Where a drive ends; None if it breaks a limit or is not clear.

        What lies between two places that are looked at is as near to one as half the way between. This may err by the
        little that the quadrature does: trajectories are judged exactly when they are complete.
        """
        speed, turn_rate = base.speed + acceleration * duration, base.turn_rate + turn_acceleration * duration
        limits, half = self.limits, 0.5 * self.model.wheel_base
        if not (
            0.0 <= speed <= SHARE * limits.speed
            and abs(turn_rate) <= SHARE * limits.turn_rate
            and speed + half * abs(turn_rate) <= SHARE * limits.wheel_speed
        ):
            return None
        t = duration * _TIMES
        yaw = base.yaw + (base.turn_rate + 0.5 * turn_acceleration * t) * t
        velocity = base.speed + acceleration * t
        lasts = duration * SHARES
        x = base.x + lasts * ((velocity * np.cos(yaw)) @ _weight)
        y = base.y + lasts * ((velocity * np.sin(yaw)) @ _weight)
        if not self.clear(x, y, 0.5 * max(base.speed, speed) * duration / SHARES.size):
            return None
        turned = 0.5 * (base.turn_rate + turn_rate) * duration
        return Base(float(x[-1]), float(y[-1]), base.yaw + turned, speed, turn_rate)

    def braking(self, base: Base) -> FloatArray:
        """Controls (n, 3) that stop the robot, both wheels at once, as quickly as the tree may."""
        wheel = base.speed + 0.5 * self.model.wheel_base * abs(base.turn_rate)
        lasts = wheel / (SHARE * self.limits.wheel_acceleration)
        if lasts == 0.0:
            return np.empty((0, 3))
        count = math.ceil(lasts / STEP)
        return np.tile([-base.speed / lasts, -base.turn_rate / lasts, lasts / count], (count, 1))

    def distance(self, base: Base) -> float:
        """How far from the goal braking ends, 1 or less for near enough; infinite if it does not end."""
        lasts = base.speed / (SHARE * self.limits.wheel_acceleration)
        off = math.hypot(base.x - self.goal[0], base.y - self.goal[1])
        if off > NEAR + base.speed * lasts:  # braking cannot make up for that
            return off / NEAR
        for control in self.braking(base):
            stopping = self.drive(base, *control.tolist())
            if stopping is None:
                return math.inf
            base = stopping._replace(speed=max(0.0, stopping.speed))  # the last is 0 but for rounding
        apart = math.hypot(base.x - self.goal[0], base.y - self.goal[1]) / NEAR
        return apart if self.goal[2] is None else max(apart, abs(float(wrap(base.yaw - self.goal[2]))) / NEAR_YAW)


def run(query: Query, seed: int) -> Run:
    """Grow one tree; its outcome depends on the arguments alone."""
    if query.arrived:
        return Run(np.empty((0, 3)), "", 0)
    with _alone:
        controls, extensions = _grow(query, seed)
    if controls is None:
        return Run(np.empty((0, 3)), "did not reach the goal", extensions)
    closed = close(query, controls)
    if closed is None:
        return Run(np.empty((0, 3)), "ended near the goal, from where it could not be led to it", extensions)
    return Run(closed, "", extensions)


def load_ompl() -> tuple[Any, Any, Any]:
    """The modules base, control and util of OMPL; raises OptionError where it is not installed."""
    try:
        return import_module("ompl.base"), import_module("ompl.control"), import_module("ompl.util")
    except ImportError as error:
        raise OptionError(
            f"planner 'rrt' needs OMPL, the extra hpop[rrt] ({error}); pip install 'hpop[rrt]', or use another planner"
        ) from None


def _grow(query: Query, seed: int) -> tuple[FloatArray | None, int]:
    """Controls (n, 3) from the start to rest near the goal, or None, and the number of extensions."""
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
            extensions += 1
            return extensions > query.extensions

        tree.solve(ob.PlannerTerminationCondition(enough))
        if not definition.hasExactSolution():
            return None, query.extensions
        return _controls(query, definition.getSolutionPath()), extensions
    finally:
        util.setLogLevel(level)


def _spaces(query: Query, ob: Any, oc: Any) -> tuple[Any, Any]:
    """States, places with velocities, and controls, the accelerations of the left and the right wheel."""
    limits, (x_min, y_min, x_max, y_max) = query.limits, query.world.bounds

    def bounds(*ranges: tuple[float, float]) -> Any:
        box = ob.RealVectorBounds(len(ranges))
        for i, (low, high) in enumerate(ranges):
            box.setLow(i, SHARE * low)
            box.setHigh(i, SHARE * high)
        return box

    places, velocities, states = ob.SE2StateSpace(), ob.RealVectorStateSpace(2), ob.CompoundStateSpace()
    places.setBounds(bounds((x_min / SHARE, x_max / SHARE), (y_min / SHARE, y_max / SHARE)))
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
    end = query.drive(base, *_of_wheels(query.model, control[0], control[1]), duration)
    _write(result, base._replace(speed=-1.0) if end is None else end)


def _of_wheels(model: DifferentialDrive, left: T, right: T) -> tuple[T, T]:
    """Acceleration, m/s², and angular acceleration, rad/s², of the base."""
    return 0.5 * (left + right), (right - left) / model.wheel_base


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
        rows += [(*_of_wheels(query.model, wheels[0], wheels[1]), STEP)] * steps
    last = _read(path.getState(path.getStateCount() - 1))
    return np.concatenate([np.array(rows).reshape(-1, 3), query.braking(last)])


def close(query: Query, controls: FloatArray) -> FloatArray | None:
    """Controls (n, 3) that end at rest exactly at the goal, free of collisions; None if no such ones are found.

    As few of the last drives are changed as will do: the last 16, 32 and so on.
    """
    trajectory = query.trajectory(controls)
    n, changed = len(controls), 0
    while changed < n:
        changed = min(n, max(LEAST_CHANGED, 2 * changed))
        kept, last = controls[: n - changed], controls[n - changed :]
        base = Base(*(float(getattr(trajectory.states, name)[n - changed]) for name in Base._fields))
        ending = _ending(query, base, last)
        if ending is not None:
            closed = np.concatenate([kept, ending])
            if _free(query, closed):
                return closed
    return None


def _free(query: Query, controls: FloatArray) -> bool:
    """Whether a trajectory is free of collisions, exactly."""
    collision = PlanarCollision(query.model, query.world)
    trajectory = query.trajectory(controls)
    return all(bool(collision.motions_free(motions).all()) for _, motions in trajectory.batches(query.world))


def _ending(query: Query, base: Base, controls: FloatArray) -> FloatArray | None:
    """Controls (k, 3) that lead from a state to rest at the goal, near the given ones; None if they break a limit.

    Newton's method on the end state as a function of all wheel accelerations. There are more of these than end states,
    so each step is the one of least norm, which spreads the gap over all drives.
    """
    half, lasts = 0.5 * query.model.wheel_base, controls[:, 2]
    wheels = np.stack([controls[:, 0] - half * controls[:, 1], controls[:, 0] + half * controls[:, 1]], axis=1)
    tried = np.concatenate([np.zeros((1, wheels.size)), SLOPE * np.eye(wheels.size)]).reshape(-1, *wheels.shape)
    goal = np.array([*query.goal[:2], query.goal[2] or 0.0, 0.0, 0.0])
    counts = np.array([1.0, 1.0, query.goal[2] is not None, 1.0, 1.0])
    for _ in range(NEWTON):
        ends = _ends(query.model, base, wheels + tried, lasts)
        off = counts * (ends[0] - goal)
        off[2] = wrap(off[2])
        if np.abs(off).max() < CLOSED:
            return _within_limits(query, base, wheels, lasts)
        slopes = counts[:, None] * (ends[1:] - ends[0]).T / SLOPE  # (5, 2k)
        wheels = wheels - np.linalg.lstsq(slopes, off)[0].reshape(wheels.shape)
    return None


def _ends(model: DifferentialDrive, base: Base, wheels: FloatArray, lasts: FloatArray) -> FloatArray:
    """End states (B, 5) from a state, by k drives each with wheel accelerations (B, k, 2)."""
    acceleration, turn_acceleration = _of_wheels(model, wheels[..., 0], wheels[..., 1])
    speed = _summed(base.speed, acceleration * lasts)  # (B, k + 1)
    turn_rate = _summed(base.turn_rate, turn_acceleration * lasts)
    yaw = _summed(base.yaw, 0.5 * (turn_rate[:, 1:] + turn_rate[:, :-1]) * lasts)
    still = np.zeros(acceleration.size)
    columns = {"yaw": yaw, "speed": speed, "turn_rate": turn_rate}
    begins = States(x=still, y=still, clock=still, **{name: c[:, :-1].ravel() for name, c in columns.items()})
    gone = ahead(begins, acceleration.ravel(), turn_acceleration.ravel(), np.tile(lasts, len(wheels)))
    x, y = (way.reshape(acceleration.shape).sum(axis=1) for way in (gone.x, gone.y))
    return np.stack([base.x + x, base.y + y, yaw[:, -1], speed[:, -1], turn_rate[:, -1]], axis=1)


def _within_limits(query: Query, base: Base, wheels: FloatArray, lasts: FloatArray) -> FloatArray | None:
    """Controls (k, 3) of wheel accelerations (k, 2), or None if they break a limit; speeds are extreme at ends."""
    limits = query.limits
    acceleration, turn_acceleration = _of_wheels(query.model, wheels[:, 0], wheels[:, 1])
    speed = base.speed + np.cumsum(acceleration * lasts)
    turn_rate = np.abs(base.turn_rate + np.cumsum(turn_acceleration * lasts))
    over = (
        -speed,
        speed - limits.speed,
        turn_rate - limits.turn_rate,
        speed + 0.5 * query.model.wheel_base * turn_rate - limits.wheel_speed,
        np.abs(wheels) - limits.wheel_acceleration,
    )
    if max(float(excess.max()) for excess in over) > CLOSED:
        return None
    return np.stack([acceleration, turn_acceleration, lasts], axis=1)


def _summed(first: float, rows: FloatArray) -> FloatArray:
    """Running sums (B, k + 1) of rows (B, k), from the first value."""
    return np.cumsum(np.concatenate([np.full((len(rows), 1), first), rows], axis=1), axis=1)
