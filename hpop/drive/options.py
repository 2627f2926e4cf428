"""Options of a drive: the front of remaining plans, and how each differs from the present plan.

Times of the drive are on the clock of the caller, s. Times of a trajectory begin at 0 at its beginning.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
import shapely

from hpop.base.arguments import checked_arguments
from hpop.base.arrays import FloatArray
from hpop.base.text import is_whole, shown
from hpop.drive.closings import Closing
from hpop.drive.plan import speed_of
from hpop.errors import DriveError
from hpop.frontier.choices import Preferring
from hpop.goals import Tour
from hpop.motions import HOLD, States, laws_of
from hpop.planners.programs.polyline import crossing_word, holes
from hpop.problems.front import Front, Point
from hpop.runtime.limits import Status
from hpop.trajectories.trajectory import Trajectory
from hpop.world import World

ALIKE = 1e-6  # m, rad or s: smaller differences count as none
STRAIGHT = "straight"


class PerceivedMotion(NamedTuple):
    """Motions that a person aboard perceives as one: consecutive straight moves, or a single other motion.

    kind        name of the motion law, such as "turn"; "straight" for moves
    change      (k + 1,) change of each of the k state variables, then of the speed; 0 for a model with one speed
    begin, end  s, from the beginning of the trajectory
    """

    kind: str
    change: FloatArray
    begin: float
    end: float


def perceived_motions(trajectory: Trajectory) -> list[PerceivedMotion]:
    """Return the motions of a trajectory as a person aboard perceives them, in order."""
    columns = [
        *(getattr(trajectory.states, name) for name in trajectory.model.space.names),
        speed_of(trajectory.states),
    ]
    steps = np.diff(np.stack(columns, axis=1), axis=0)
    motions, laws = list[PerceivedMotion](), laws_of(trajectory.model)
    for i, kind in enumerate(trajectory.kinds):
        moves = "x" in laws[kind].varies
        motion = PerceivedMotion(
            STRAIGHT if moves else kind, steps[i], float(trajectory.times[i]), float(trajectory.times[i + 1])
        )
        if moves and motions and motions[-1].kind == STRAIGHT:
            motion = motion._replace(change=motions[-1].change + motion.change, begin=motions.pop().begin)
        motions.append(motion)
    return motions


def leaves(trajectory: Trajectory, announced: Trajectory) -> float | None:
    """Return how long after its beginning, s, a trajectory departs from the announced one; None if it never does.

    Both begin at the same place and time. If both go straight ahead, they part where the shorter straight run ends.
    """
    own, expected = perceived_motions(trajectory), perceived_motions(announced)
    for mine, theirs in zip(own, expected, strict=False):
        if mine.kind != theirs.kind:
            return mine.begin
        if mine.kind in (STRAIGHT, HOLD.kind) and abs(mine.end - theirs.end) > ALIKE:
            return min(mine.end, theirs.end)
        if np.abs(mine.change - theirs.change).max() > ALIKE:
            return mine.begin
    return None if len(own) == len(expected) else min(trajectory.duration, announced.duration)


def next_turn(trajectory: Trajectory, t: float) -> float | None:
    """Return the beginning of the first turn in place that begins after ``t``; None if there is none.

    Both are in s from the beginning of the trajectory.
    """
    later = [
        time
        for time, kind in zip(trajectory.times.tolist(), trajectory.kinds, strict=False)
        if kind.startswith("turn") and time > t
    ]
    return later[0] if later else None


def same_side(trajectory: Trajectory, other: Trajectory, world: World, closings: Sequence[Closing] = ()) -> bool | None:
    """Return whether two trajectories pass obstacles and closed areas on the same sides; None if their ends differ."""
    there, back = (np.stack([t.states.x, t.states.y], axis=1) for t in (trajectory, other))
    if np.abs(there[-1] - back[-1]).max() > ALIKE:
        return None
    loop = np.concatenate([there, back[::-1], there[:1]])
    heights = {(part.z_min, part.z_max) for part in trajectory.model.platform}
    points = [holes(loop, world.ground.free_space(z)) for z in sorted(heights)]
    # More points than obstacles do no harm: two in one obstacle, or one that no free loop encloses.
    areas = [part for closing in closings for part in shapely.get_parts(closing.area)]
    points.append(shapely.get_coordinates(shapely.point_on_surface(areas)).reshape(-1, 2))
    return not crossing_word(loop, np.concatenate(points))


class LeavePoints(NamedTuple):
    """Places at which a drive may change its plan.

    times   (L,)  s, times of the drive
    states  (L,)  states of the robot
    """

    times: FloatArray
    states: States


@dataclass(frozen=True, eq=False)
class Commit:
    """The next place at which a drive may change its plan; up to there the plan is fixed.

    time     s, time of the drive at which the robot is there
    state    (1,) state of the robot there
    place    index of the state in the driven plan
    stands   s, time for which the robot stands there first
    arrives  whether this place is the goal
    before   the plan up to there, with the time for which the robot stands there
    remaining  the announced plan from there on
    later    further places, soon afterwards, at which the robot may change its plan
    tour     the tour, with the stops that are done there; None without a tour
    """

    time: float
    state: States
    place: int
    stands: float
    arrives: bool
    before: Trajectory
    remaining: Trajectory
    later: LeavePoints
    tour: Tour | None = None

    @property
    def places(self) -> LeavePoints:
        """Places where the plan may change: that of the commit, and the further ones soon after it."""
        here, later = self.state.__dict__, self.later.states
        states = States(**{name: np.append(column, getattr(later, name)) for name, column in here.items()})
        return LeavePoints(np.append(self.time, self.later.times), states)


@dataclass(frozen=True, eq=False, repr=False)
class Option(Point):
    """A remaining plan from the commit on, the next place where the plan may change; see :class:`.Point`.

    leaves_at   s, time of the drive at which it departs from the announced plan; None: never
    next_turn   s from now until the next turn in place begins; None: there is none
    same_side   whether it passes all obstacles on the same sides as the announced plan; None: it ends elsewhere
    keeps_on    whether it is the present plan
    dominated   whether another option is no worse in any cost; only the present plan is listed in that case
    """

    leaves_at: float | None = None
    next_turn: float | None = None
    same_side: bool | None = None
    keeps_on: bool = False
    dominated: bool = False

    @property
    def stops(self) -> tuple[str, ...]:
        """Names of the tour's stops that this plan visits from its beginning at the commit on; () without a tour.

        They are in the order of the visits.
        """
        return tuple(visit["stop"] for visit in self.provenance.get("visits", ()))


@checked_arguments
@dataclass(frozen=True, eq=False, repr=False)
class Options(Sequence[Option]):
    """Front of the plans from the commit to the goal; the present plan is one of them if nothing is in its way.

    front     the plans with their costs, which count from the commit on; only costs that are maxima or means count
              from the begin of the drive
    now       s, time of the drive at which options were computed
    commit    the place where the remaining plans begin
    keep_on   index of the present plan among the options; None if a closed area or a person is in its way
    kept      the present plan if another plan dominates it, else None; it is then the last option, after the front
    status    COMPLETE, NO_PATH, or the limit that stopped the search
    gap       for every missing cost vector, a vector of the front is at most a factor 1 + gap worse
    labels    number of partial paths that the search generated
    compared  the plan whose path was announced to the viewer; columns such as "leaves at" compare options with it
    unreachable  names of the tour's stops that must still be visited but cannot be reached; there is then no option
    """

    front: Front
    now: float
    commit: Commit
    keep_on: int | None
    kept: Point | None
    status: Status
    gap: float
    labels: int
    compared: PlanComparison = field(kw_only=True)
    unreachable: tuple[str, ...] = ()

    @property
    def certificate(self) -> str:
        """The certificate of the front: the guarantee of the search, as text."""
        return self.front.certificate

    @property
    def ways(self) -> tuple[Trajectory, ...]:
        """The trajectories of the options, in order."""
        return self.front.trajectories if self.kept is None else (*self.front.trajectories, self.kept.item)

    def costs_of(self, index: int) -> dict[str, float]:
        """Return the costs of an option, given by its number, by criterion."""
        return self._point(index).costs

    def __len__(self) -> int:
        return len(self.front) + (self.kept is not None)

    def __getitem__(self, index: Any) -> Any:
        """Return an option by its number, or several by a slice."""
        if isinstance(index, slice):
            return [self[i] for i in range(*index.indices(len(self)))]
        if not -len(self) <= index < len(self):
            raise IndexError(f"there are {len(self)} options, got index {index}")
        return self._option(index % len(self))

    def __iter__(self) -> Iterator[Option]:
        return (self._option(i) for i in range(len(self)))

    def __repr__(self) -> str:
        kept = "" if self.keep_on is None else f", number {self.keep_on} keeps on"
        return f"<Options: {len(self)} from {self.commit.time:.2f} s on{kept}; {self.status}>"

    def _point(self, index: int) -> Point:
        point = self.front[index] if index < len(self.front) else self.kept
        assert point is not None
        return point

    def _option(self, index: int) -> Option:
        point, keeps_on = self._point(index), index == self.keep_on
        return Option(
            index=index,
            costs=point.costs,
            reported=point.reported,
            item=point.item,
            provenance=point.provenance,
            keeps_on=keeps_on,
            dominated=index >= len(self.front),
            **self.compared.of(point.item, self, keeps_on=keeps_on),
        )

    # Choosing

    def knee(self) -> Option:
        """Return the option at the knee of the front, the best compromise; see :meth:`hpop.Front.knee`."""
        return self._option(self.front.knee().index)

    def best(self, name: str) -> Option:
        """Return the option with the least cost in one criterion; see :meth:`hpop.Front.best`."""
        return self._option(self.front.best(name).index)

    def lexicographic(self, order: Sequence[str]) -> Option:
        """Return the best option by criteria in order of priority; see :meth:`hpop.Front.lexicographic`."""
        return self._option(self.front.lexicographic(order).index)

    def select(self, weights: Mapping[str, float] | None = None, *, preference: Preferring | None = None) -> Option:
        """Return the option with the least weighted sum, or the one that a person prefers; see `hpop.Front.select`."""
        return self._option(self.front.select(weights, preference=preference).index)

    def nearest(self, wishes: Mapping[str, float]) -> Option:
        """Return the option nearest to wished values; see :meth:`hpop.Front.nearest`."""
        return self._option(self.front.nearest(wishes).index)

    def reference_point(self, aspirations: Mapping[str, float]) -> Option:
        """Return the option that meets aspired costs best; see :meth:`hpop.Front.reference_point`."""
        return self._option(self.front.reference_point(aspirations).index)

    def place_of(self, chosen: Any) -> int:
        """Return the index of an option, given as the option, as a point of :attr:`front`, or as an index."""
        if not len(self):
            raise DriveError(f"there is no option to take: {self.certificate}")
        if is_whole(chosen) and -len(self) <= chosen < len(self):
            return int(chosen) % len(self)
        if isinstance(chosen, Point):
            for i, trajectory in enumerate(self.ways):
                if trajectory is chosen.item:
                    return i
        raise DriveError(f"take one of the last options, or its number, 0 to {len(self) - 1}; got {shown(chosen)}")


@dataclass(frozen=True, eq=False)
class PlanComparison:
    """The announced plan, with which options are compared.

    before      the plan up to the commit, where it may change next
    announced   the announced plan from there on
    query_time  s, time on the plan at which options were computed
    sides       function that returns whether a trajectory passes obstacles on the same sides as the announced plan
    """

    before: Trajectory
    announced: Trajectory
    query_time: float
    sides: Callable[[Trajectory], bool | None]

    def of(self, trajectory: Trajectory, options: Options, *, keeps_on: bool) -> dict[str, Any]:
        """Return the fields `leaves_at`, `next_turn` and `same_side` of :class:`Option` for one of the options.

        trajectory  its trajectory from the commit on
        options     all options, of which the commit and the present time are used
        keeps_on    whether it is the present plan
        """
        at = None if keeps_on else leaves(trajectory, self.announced)
        sooner = next_turn(self.before, self.query_time)
        later = next_turn(trajectory, -1.0)
        turn = None if sooner is None else sooner - self.query_time
        if turn is None and later is not None:
            turn = options.commit.time - options.now + later
        return {
            "leaves_at": None if at is None else options.commit.time + at,
            "next_turn": turn,
            "same_side": True if keeps_on else self.sides(trajectory),
        }
