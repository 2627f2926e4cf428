"""What may be chosen while a robot drives: the front of the rest of the way, and what each choice would change."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
import shapely

from hpop.base.arguments import checked_arguments
from hpop.base.arrays import FloatArray
from hpop.base.scalars import is_whole
from hpop.base.text import shown
from hpop.drive.closings import Closing
from hpop.errors import DriveError
from hpop.frontier.choices import Preferring
from hpop.motions import HOLD, States, laws_of
from hpop.planners.programs.polyline import crossing_word, holes
from hpop.problems.front import Front, Point
from hpop.runtime.status import Status
from hpop.trajectories.trajectory import Trajectory
from hpop.world import World

ALIKE = 1e-6  # m, rad or s: what differs by less is the same
STRAIGHT = "straight"


class Run(NamedTuple):
    """Motions of a way that nobody aboard tells apart: straight ones in a row, or another one.

    kind        its law's, "straight" of moves
    change      by how much each state changes
    begin, end  s
    """

    kind: str
    change: FloatArray
    begin: float
    end: float


def runs(way: Trajectory) -> list[Run]:
    """The runs of a way, in order."""
    steps = np.stack([np.diff(getattr(way.states, name)) for name in way.model.space.names], axis=1)
    found, laws = list[Run](), laws_of(way.model)
    for i, kind in enumerate(way.kinds):
        moves = "x" in laws[kind].varies
        run = Run(STRAIGHT if moves else kind, steps[i], float(way.times[i]), float(way.times[i + 1]))
        if moves and found and found[-1].kind == STRAIGHT:
            run = run._replace(change=found[-1].change + run.change, begin=found.pop().begin)
        found.append(run)
    return found


def leaves(way: Trajectory, announced: Trajectory) -> float | None:
    """When, s, a way leaves another that begins where it does; None where it never does.

    Both go straight ahead, so of two straight runs the shorter one is left at its end.
    """
    one, other = runs(way), runs(announced)
    for mine, theirs in zip(one, other, strict=False):
        if mine.kind != theirs.kind:
            return mine.begin
        if mine.kind in (STRAIGHT, HOLD.kind) and abs(mine.end - theirs.end) > ALIKE:
            return min(mine.end, theirs.end)
        if np.abs(mine.change - theirs.change).max() > ALIKE:
            return mine.begin
    return None if len(one) == len(other) else min(way.duration, announced.duration)


def next_turn(way: Trajectory, t: float) -> float | None:
    """When, s, the first turn of a way later than ``t`` begins; None where there is none."""
    later = [time for time, kind in zip(way.times.tolist(), way.kinds, strict=False) if kind == "turn" and time > t]
    return later[0] if later else None


def same_side(way: Trajectory, other: Trajectory, world: World, closings: Sequence[Closing] = ()) -> bool | None:
    """Whether two ways of a robot in the plane pass all obstacles and closings on the same sides, in the same order.

    None where they end at different places, so that there is no telling.
    """
    one, two = (np.stack([t.states.x, t.states.y], axis=1) for t in (way, other))
    if np.abs(one[-1] - two[-1]).max() > ALIKE:
        return None
    loop = np.concatenate([one, two[::-1], one[:1]])
    heights = {(part.z_min, part.z_max) for part in way.model.platform}
    points = [holes(loop, world.ground.free_space(z)) for z in sorted(heights)]
    # A point too many is harmless: two in one obstacle, or one that no free loop goes about.
    areas = [part for closing in closings for part in shapely.get_parts(closing.area)]
    points.append(shapely.get_coordinates(shapely.point_on_surface(areas)).reshape(-1, 2))
    return not crossing_word(loop, np.concatenate(points))


class Later(NamedTuple):
    """Places of a plan at which a drive may take another way.

    times   (L,)  s, of the drive
    states  (L,)  of the robot, then
    """

    times: FloatArray
    states: States


@dataclass(frozen=True, eq=False)
class Commit:
    """Where a drive may take another way: until then nothing changes any more.

    time     s, of the drive
    state    (1,) of the robot, then
    place    the state of the plan that is driven, by number
    stands   s that the robot stands there before
    arrives  whether that is the goal
    before   what is driven until then
    later    places soon after it at which the robot may do so as well
    """

    time: float
    state: States
    place: int
    stands: float
    arrives: bool
    before: Trajectory
    later: Later

    @property
    def places(self) -> Later:
        """The commit's own place and those soon after it."""
        here, later = self.state.__dict__, self.later.states
        states = States(**{name: np.append(column, getattr(later, name)) for name, column in here.items()})
        return Later(np.append(self.time, self.later.times), states)


@dataclass(frozen=True, eq=False, repr=False)
class Option(Point):
    """One way to go on from where another way may be taken; see :class:`hpop.problems.front.Point`.

    leaves_at   s, of the drive: when it leaves the announced way; None: never
    next_turn   s from now on until the robot's next turn in place begins; None: there is none
    same_side   whether it passes all obstacles on the same sides as the announced way; None: it ends elsewhere
    keeps_on    whether it is the present plan
    dominated   whether another option is better: only the present plan is listed then
    """

    leaves_at: float | None = None
    next_turn: float | None = None
    same_side: bool | None = None
    keeps_on: bool = False
    dominated: bool = False


@checked_arguments
@dataclass(frozen=True, eq=False, repr=False)
class Options(Sequence[Option]):
    """The front of the rest of a drive, and the present plan among its points.

    front     costs of the rest from the commit on; worst moments and means are those of the whole drive
    now       s, of the drive, when it was asked
    commit    where the rest begins
    keep_on   place of the present plan among the options, None where it is closed
    kept      the present plan where others are better than it: it is listed after the points of the front
    status    COMPLETE, NO_PATH, or what stopped the search
    gap       every missing vector is covered by one of the front within the factor 1 + gap
    labels    count  partial paths that the search made
    compared  what options are compared with
    """

    front: Front
    now: float
    commit: Commit
    keep_on: int | None
    kept: Point | None
    status: Status
    gap: float
    labels: int
    compared: Compared = field(kw_only=True)

    @property
    def certificate(self) -> str:
        """What is claimed of the front."""
        return self.front.certificate

    @property
    def ways(self) -> tuple[Trajectory, ...]:
        """The ways that may be driven, in the order of the options."""
        return self.front.trajectories if self.kept is None else (*self.front.trajectories, self.kept.item)

    def __len__(self) -> int:
        return len(self.front) + (self.kept is not None)

    def __getitem__(self, index: Any) -> Any:
        """An option by its number, or several by a slice."""
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

    def _option(self, index: int) -> Option:
        point = self.front[index] if index < len(self.front) else self.kept
        assert point is not None
        keeps_on = index == self.keep_on
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
        """The best compromise; see :meth:`hpop.Front.knee`."""
        return self._option(self.front.knee().index)

    def best(self, name: str) -> Option:
        """The least in one criterion; see :meth:`hpop.Front.best`."""
        return self._option(self.front.best(name).index)

    def lexicographic(self, order: Sequence[str]) -> Option:
        """The best by criteria in an order; see :meth:`hpop.Front.lexicographic`."""
        return self._option(self.front.lexicographic(order).index)

    def select(self, weights: Mapping[str, float] | None = None, *, preference: Preferring | None = None) -> Option:
        """The least weighted sum, or what a person prefers; see :meth:`hpop.Front.select`."""
        return self._option(self.front.select(weights, preference=preference).index)

    def nearest(self, wishes: Mapping[str, float]) -> Option:
        """The nearest to some wished values; see :meth:`hpop.Front.nearest`."""
        return self._option(self.front.nearest(wishes).index)

    def reference_point(self, aspirations: Mapping[str, float]) -> Option:
        """The best against aspirations; see :meth:`hpop.Front.reference_point`."""
        return self._option(self.front.reference_point(aspirations).index)

    def place_of(self, chosen: Any) -> int:
        """The number of an option that is given as itself, as a point of :attr:`front`, or by its number."""
        if is_whole(chosen) and -len(self) <= chosen < len(self):
            return int(chosen) % len(self)
        if isinstance(chosen, Point):
            for i, way in enumerate(self.ways):
                if way is chosen.item:
                    return i
        raise DriveError(f"take one of the last options, or its number, 0 to {len(self) - 1}; got {shown(chosen)}")


@dataclass(frozen=True, eq=False)
class Compared:
    """What options are compared with.

    before     what is driven up to the commit
    announced  the announced rest from there
    sides      whether a way passes obstacles on the same sides as the announced rest
    """

    before: Trajectory
    announced: Trajectory
    asked: float
    sides: Callable[[Trajectory], bool | None]

    def of(self, way: Trajectory, options: Options, *, keeps_on: bool) -> dict[str, Any]:
        """`leaves_at`, `next_turn` and `same_side` of a way from the commit on."""
        at = None if keeps_on else leaves(way, self.announced)
        sooner = next_turn(self.before, self.asked)
        later = next_turn(way, -1.0)
        turn = None if sooner is None else sooner - self.asked
        if turn is None and later is not None:
            turn = options.commit.time - options.now + later
        return {
            "leaves_at": None if at is None else options.commit.time + at,
            "next_turn": turn,
            "same_side": True if keeps_on else self.sides(way),
        }
