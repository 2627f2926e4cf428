"""Fronts of speed profiles along one path: duration against a discomfort."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from hpop.base.arguments import checked_arguments
from hpop.base.arrays import FloatArray, IntArray, frozen
from hpop.base.options import LEAST, MOST, real, whole
from hpop.base.text import shown
from hpop.criteria.base import Criterion, CriterionSpec, check_usable, make_criterion
from hpop.criteria.comfort.sickness import W_F
from hpop.criteria.costs import motion_costs, trajectory_costs
from hpop.errors import ModelError, OptionError, QueryError
from hpop.motions import HOLD, Motions, States, Vector
from hpop.motions.by_law import extras
from hpop.motions.laws import CLOCK
from hpop.planners.base import Candidates
from hpop.planners.needs import people_move
from hpop.planners.programs.path_coordinates import Coordinates, coordinates_of
from hpop.planners.programs.speed_profiles import Discomfort, Profiles
from hpop.planners.programs.stretches import PathStretch, ZoneLimits, stretches_of
from hpop.planners.programs.weighted_profiles import WeightedMotion
from hpop.problems.front import Front
from hpop.problems.problem import Problem
from hpop.problems.solving import front as evaluated_front
from hpop.problems.verify import collision_free
from hpop.runtime.limits import Status
from hpop.trajectories.trajectory import Trajectory
from hpop.world import World

MOST_POINTS = 1000
FACTOR = 20.0  # largest value of `slowest`
SLOWER, TRIALS = 1.0005, 80  # factor on the time, and largest number of them, until a curved path keeps its limits
EXACT, QUADRATURE, WEIGHTED, SAMPLED = (
    1e-6,
    1e-2,
    2e-2,
    0.25,
)  # shares by which planned and re-evaluated costs may differ
CONSTANT = 1e-9  # a smaller discomfort of the fastest profile is none


def _derivatives(problem: Problem, path: _Path, body: str, in_frame: bool) -> tuple[FloatArray, FloatArray]:
    """Return first and second derivatives (N, 3) of a body's position along the path, in its frame or the world's."""
    slopes, bends = list[FloatArray](), list[FloatArray]()
    for one in path.stretches:
        rates, changes = path.coordinates.rates_of_states(one.middle, *one.in_middle)
        model, size = problem.model, one.steps.size
        for rows, twist in (
            (slopes, model.twist(body, one.middle, rates)),
            (bends, model.twist_rate(body, one.middle, rates, changes)),
        ):
            found = _columns(twist.velocity, size)
            if in_frame:
                pose = model.pose(body, one.middle)
                axes = [_columns(axis, size) for axis in (pose.ahead, pose.left, pose.up)]
                found = np.stack([(found * axis).sum(axis=1) for axis in axes], axis=1)
            rows.append(found)
    return np.concatenate(slopes), np.concatenate(bends)


def _columns(vector: Vector, size: int) -> FloatArray:
    """Return a vector's components, each a column or a number, as an array (size, 3)."""
    return np.stack([np.broadcast_to(np.asarray(v, float), size) for v in vector], axis=1)


def _camera_acceleration(problem: Problem, criterion: Criterion, path: _Path) -> Discomfort:
    """Return the data of the discomfort "squared_acceleration"."""
    slopes, bends = _derivatives(problem, path, "camera", in_frame=False)
    return Discomfort(slopes=slopes, bends=bends)


def _weighted_acceleration(problem: Problem, criterion: Criterion, path: _Path) -> Discomfort:
    """Return the data of the discomfort "felt_msdv"."""
    slopes, bends = _derivatives(problem, path, "seat", in_frame=True)
    steps, first, pauses, held = list[FloatArray](), list[IntArray](), list[FloatArray](), 0.0
    for part in path.parts:
        if not isinstance(part, PathStretch):
            held += part
            continue
        steps.append(part.steps)
        first.append(np.arange(part.steps.size) + sum(one.size + 1 for one in first))
        pauses.append(np.append(held, np.zeros(part.steps.size - 1)))
        held = 0.0
    grid = np.concatenate(steps), np.concatenate(first), np.concatenate(pauses)
    return Discomfort(slopes=slopes, bends=bends, weighted=WeightedMotion(slopes, bends, *grid, W_F, stays=held))


def _largest_flow(problem: Problem, criterion: Criterion, path: _Path) -> Discomfort:
    """Return the data of the discomfort "peak_optic_flow": the largest flow in each interval, at unit path speed."""
    flows = []
    for one in path.stretches:
        knots = path.coordinates.knots(one.states, one.slopes, np.append(0.0, np.cumsum(one.steps)))
        n = one.steps.size
        start, end = knots.take(slice(0, n)), knots.take(slice(1, n + 1))
        largest, kinds = np.zeros(n), np.array(one.kinds)
        for kind in dict.fromkeys(one.kinds):
            (own,) = (kinds == kind).nonzero()
            law, ends = problem.model.laws[kind], (start.take(own), end.take(own))
            largest[own] = motion_costs(criterion, Motions(problem.world, problem.model, law, *ends))
        flows.append(largest)
    return Discomfort(flow=np.concatenate(flows))


DISCOMFORTS: Mapping[str, tuple[Callable[[Problem, Criterion, _Path], Discomfort], float]] = {
    "squared_acceleration": (_camera_acceleration, QUADRATURE),
    "peak_optic_flow": (_largest_flow, SAMPLED),
    "felt_msdv": (_weighted_acceleration, WEIGHTED),
}
"""Discomforts by the name of their criterion: their data for programs, and the tolerance of planned costs."""


@dataclass(frozen=True, eq=False)
class _Path:
    """Path of an executed trajectory: stretches in which the robot moves, and seconds for which it stands.

    run          the executed trajectory
    coordinates  coordinates of the robot along the path
    parts        stretches and, as floats, the seconds of the holds, in order of time
    """

    run: Trajectory
    coordinates: Coordinates
    parts: tuple[PathStretch | float, ...]

    @classmethod
    def of(cls, trajectory: Trajectory, world: World) -> _Path:
        run, coordinates = trajectory.execution(), coordinates_of(trajectory.model)
        return cls(run, coordinates, tuple(stretches_of(run, coordinates, ZoneLimits.of(world, run))))

    @cached_property
    def stretches(self) -> list[PathStretch]:
        return [part for part in self.parts if isinstance(part, PathStretch)]

    @property
    def held(self) -> float:
        """Seconds for which the robot stands in all."""
        return sum(part for part in self.parts if not isinstance(part, PathStretch))

    @property
    def is_straight(self) -> bool:
        """True if the path between any two standstills is a straight line of the coordinates.

        Speed profiles follow such a path exactly.
        """
        return not any(one.bends.any() for one in self.stretches)

    @cached_property
    def exceeded(self) -> tuple[str, ...]:
        """Limits that ``run``, the executed trajectory, exceeds somewhere: "speed zones", "the limits of steering".

        Excesses of less than one millionth, which come from rounding, do not count.
        """
        limits = {
            "speed zones": [one.in_zones for one in self.stretches],
            "the limits of steering": [one.most for one in self.stretches],
        }
        paces = [one.pace / (1.0 + EXACT) for one in self.stretches]
        return tuple(
            name for name, most in limits.items() if any((a > b).any() for a, b in zip(paces, most, strict=True))
        )

    def trajectory(self, profiles: Profiles, b: FloatArray) -> Trajectory:
        """Return the trajectory with a speed profile ``b``: the squared speed along the path at all grid positions."""
        lasts, root, coordinates = profiles.durations(b), np.sqrt(b), self.coordinates
        knots, kinds, now, interval, place = list[States](), list[str](), 0.0, 0, 0
        for part in self.parts:
            if not isinstance(part, PathStretch):
                kinds.append(HOLD.kind)
                now += part
                if not knots:
                    knots.append(coordinates.knots(self.run.at(0.0), np.zeros((1, coordinates.unit.size)), np.zeros(1)))
                knots.append(States(**knots[-1].take([-1]).__dict__ | {CLOCK: np.array([now])}))
                continue
            n = part.steps.size
            clock = now + np.append(0.0, np.cumsum(lasts[interval : interval + n]))
            rates = part.slopes * root[place : place + n + 1, None]
            stretch = coordinates.knots(part.states, rates, clock)
            knots.append(stretch.take(slice(1 if knots else 0, None)))
            kinds += part.kinds
            now, interval, place = float(clock[-1]), interval + n, place + n + 1
        names = (*self.run.model.space.names, *extras(self.run.model, kinds))
        states = States(**{name: frozen(np.concatenate([getattr(k, name) for k in knots])) for name in names})
        return Trajectory(self.run.model, states, tuple(kinds))


@checked_arguments
def retime(
    problem: Problem,
    trajectory: Trajectory,
    *,
    discomfort: CriterionSpec = "squared_acceleration",
    points: int = 12,
    slowest: float = 2.0,
    jerk: float | None = None,
) -> Front:
    """Return the front of speed profiles along the path of a trajectory: duration against a discomfort.

    The path and its holds stay. Limits of speed zones are kept. Each point is the gentlest profile for its duration, by
    a convex program. With a limit of ``jerk``, and for "felt_msdv", gentler ones may exist. The first one is the
    fastest. The other criteria of the problem are evaluated and reported.

    Parameters
    ----------
    discomfort : "squared_acceleration", "peak_optic_flow" or, for a robot with a seat, "felt_msdv"; or such a criterion
        with parameters
    points : number of durations that are tried, in equal ratios, from the least one to ``slowest`` times it
    slowest : largest duration of the moving parts, as a multiple of the least one
    jerk : largest jerk, in m/s³ for moves, rad/s³ for turns, and the units of the joints of an arm; None: no limit

    Raises UnsupportedModel for a robot without a law for any speed, QueryError among people who move, OptionError for
    invalid options, and for a jerk on a path with curves.

    >>> import hpop
    >>> museum = hpop.examples.museum()
    >>> path = hpop.Trajectory.from_poses(museum.model, [museum.start, (10, 2, 0)])
    >>> problem = hpop.Problem(museum.world, museum.model, museum.start, (10, 2, 0), ["length"])
    >>> front = hpop.retime(problem, path, points=5)
    >>> front.names, len(front)
    (('duration', 'squared_acceleration'), 5)
    """
    points = whole("points", points, 1, MOST_POINTS, "a number of speed profiles")
    slowest = real("slowest", slowest, 1.0 + EXACT, FACTOR, "a multiple of the least duration, over 1")
    if jerk is not None:
        jerk = real("jerk", jerk, LEAST, MOST, "a jerk, in m/s³, rad/s³ or units of joints,")
    criterion = _discomfort(problem, discomfort)
    if trajectory.model != problem.model:
        raise ModelError(
            "the trajectory is of another robot than the problem; give a trajectory of the problem's model"
        )
    if trajectory.punctual:
        raise QueryError(
            "the trajectory was planned among people who move, so it must keep its times, which retime would change; "
            "retime one that was planned without them"
        )
    if people_move(problem):
        raise QueryError(
            "retime does not know where people walk at what time, so it would not keep clear of them; take people who "
            "move out of the problem"
        )
    began = time.perf_counter()
    path = _Path.of(trajectory, problem.world)
    if not path.stretches:
        raise OptionError("the trajectory does not move, so it has no speed to choose; retime one that moves")
    if jerk is not None and not path.is_straight:
        raise OptionError(
            "jerk can be limited along straight moves, turns in place and reaches, but this path has curves, along "
            "which accelerations jump at any speed; leave jerk out, or retime a path of a lattice or a roadmap"
        )
    build, tolerance = DISCOMFORTS[criterion.name]
    if jerk is not None and build is _weighted_acceleration:
        raise OptionError(f"jerk cannot be limited with the discomfort {criterion.name}; leave jerk out")
    check_usable(criterion, problem.model, problem.world)
    profiles = Profiles(path.stretches, build(problem, criterion, path), jerk)
    own = [c for c in problem.criteria if c.role == "stops_missed"]  # a tour with optional stops needs it
    names = {"duration", criterion.name, *(c.name for c in own)}
    quanta = {name: quantum for name, quantum in problem.quanta.items() if name in names}
    asked = replace(problem, criteria=(make_criterion("duration"), criterion, *own), quanta=quanta)
    found = _swept(path, profiles, points, slowest)
    faster = path.run.duration < found[0][0].duration * (1.0 - EXACT)  # its curves are not on the grid
    if jerk is None and faster and not path.exceeded and not any(True for _ in problem.model.faults(path.run)):
        found.insert(0, (path.run, float(trajectory_costs([criterion], [path.run], problem.world)[0, 0])))
    free = np.ones(len(found), bool) if path.is_straight else collision_free(asked, [t for t, _ in found])
    kept = [one for one, is_free in zip(found, free.tolist(), strict=True) if is_free]
    planned = np.array([[t.duration, cost, *np.zeros(len(own))] for t, cost in kept]).reshape(len(kept), 2 + len(own))
    candidates = Candidates(
        objectives=asked.criteria,
        filters=(),
        trajectories=tuple(t for t, _ in kept),
        planned=planned,
        tolerance=np.array([EXACT, tolerance, *np.full(len(own), np.inf)]) * np.maximum(planned, 1.0),
        status=Status.COMPLETE,
        certificate=_certificate(profiles, criterion),
        provenance=tuple({"planner": "retime", "discomfort": criterion.name, "jerk": jerk} for _ in kept),
        notes=_notes(path, profiles, criterion, len(found) - len(kept)),
        stats={"planner": "retime", "intervals": int(profiles.steps.size), "seconds": time.perf_counter() - began},
    )
    also = [c for c in problem.criteria if c.name not in names]
    result = evaluated_front(asked, candidates)
    return asked.evaluate(result, also=also) if also else result


def _discomfort(problem: Problem, given: CriterionSpec) -> Criterion:
    """Return the criterion of a discomfort: the problem's own if only its name is given."""
    own = {c.name: c for c in problem.criteria}
    criterion = own[given] if isinstance(given, str) and given in own else make_criterion(given)
    if criterion.name not in DISCOMFORTS:
        raise OptionError(
            f"discomfort must be one of {', '.join(DISCOMFORTS)}, got {shown(criterion.name)}; list other criteria in "
            "the problem, to have them evaluated"
        )
    return criterion


def _swept(path: _Path, profiles: Profiles, points: int, slowest: float) -> list[tuple[Trajectory, float]]:
    """Return trajectories, from the fastest to the slowest, each with its discomfort as the program has it.

    ``points`` durations are tried, up to ``slowest`` times the least one, as for :func:`retime`.
    """
    b, found = profiles.fastest, list[tuple[Trajectory, float]]()
    least = float(profiles.durations(b).sum())
    constant = profiles.cost(b) < CONSTANT
    for ratio in np.geomspace(1.0, slowest, 1 if constant else points).tolist():
        solved = b if ratio == 1.0 else profiles.gentlest(ratio * least, b)
        if solved is None:
            continue
        b = solved
        for _ in range(TRIALS):
            trajectory = path.trajectory(profiles, solved)
            if path.is_straight or not any(True for _ in trajectory.model.faults(trajectory)):
                found.append((trajectory, profiles.cost(solved)))
                break
            solved = solved / SLOWER**2
    if not found:
        raise OptionError(
            "no speed profile of this path keeps the limits of the robot; check that its trajectory does: `hpop show`"
        )
    return found


def _certificate(profiles: Profiles, criterion: Criterion) -> str:
    """Return the claim for a front of speed profiles: each has the least cost, or little cost, for its duration."""
    claim = (
        f"each point is the speed profile of least {criterion.name} for its duration on one path, with constant "
        f"acceleration along it in each of {profiles.steps.size:,} intervals (convex programs, solved by Clarabel)"
    )
    if profiles.discomfort.weighted is not None:
        return (
            f"each point has little {criterion.name} for its duration on one path, with constant acceleration along "
            f"it in each of {profiles.steps.size:,} intervals, by a nonlinear program (IPOPT) or its "
            "first guess if that is better, so that better profiles may exist; the first point is the fastest profile"
        )
    if profiles.jerk is None:
        return claim
    return (
        f"each point has little {criterion.name} for its duration on one path, with constant acceleration along it in "
        f"each of {profiles.steps.size:,} intervals; the mean jerk from each interval to the next is at most "
        f"{profiles.jerk:g}, by a series of convex restrictions, so that better profiles may exist"
    )


def _notes(path: _Path, profiles: Profiles, criterion: Criterion, colliding: int) -> tuple[str, ...]:
    """Return notes on profiles for the user."""
    notes = []
    if path.exceeded:
        limits = " and ".join(path.exceeded)
        notes.append(f"the given trajectory is faster than {limits} allow; the profiles keep their limits")
    if profiles.cost(profiles.fastest) < CONSTANT:
        notes.append(f"the path has no {criterion.name} at any speed, so only the fastest profile is left")
    if colliding:
        notes.append(f"{colliding} speed profiles are left out, since they do not keep clear of obstacles in curves")
    return tuple(notes)
