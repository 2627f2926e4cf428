"""Path of a trajectory, cut into stretches between standstills, each on a grid of path positions.

Let q be the coordinates of a robot: the distance driven and the heading of a base, and the joints that it carries; or
the joints of an arm. A stretch has a path coordinate s, which grows by the length of dq with each coordinate divided by
its largest speed. So the unit of s is the second, and ds/dt is about 1 at full speed. Between two neighbouring grid
positions, dq/ds is quadratic in s. Speed zones of the world limit the speed along a stretch (:class:`ZoneLimits`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from hpop.base.arrays import FloatArray
from hpop.criteria.others.zones import speed_limits
from hpop.errors import OptionError
from hpop.motions import HOLD, States, is_curve, laws_of
from hpop.motions.laws import CLOCK
from hpop.planners.programs.path_coordinates import REST, Coordinates
from hpop.trajectories.trajectory import Trajectory
from hpop.world import World
from hpop.world.fields.field import Field

INTERVAL, FEWEST, MOST = 0.1, 16, 400  # s: length of a grid interval at the input's speed; intervals in each phase
FEW = 4  # intervals in each motion along an arc or a clothoid
CURVED = 600  # intervals in all motions of a stretch of curves
BEFORE = 1e-7  # share of an interval: how long before a grid position its rates may be taken
STRAIGHT = 1e-9  # difference of unit directions that is a rounding error
PARALLEL = 1e-6  # difference of unit directions that counts as none


@dataclass(frozen=True, eq=False)
class PathStretch:
    """Part of a path between two standstills, on a grid of n + 1 positions.

    kinds          (n,)           kinds of the laws that drive the intervals at any speed profile, such as "drive"
    steps          (n,)           differences of the path coordinate s, all positive
    states         (n+1,)         states of the model
    slopes         (n+1, c)       dq/ds
    bends          (2, n, c)      d²q/ds² at the start and at the end of each interval, linear between them
    pace           (n+1,)         ds/dt of the trajectory from which the stretch was made, 0 at both ends
    most           (n+1,)         largest ds/dt by limits beside those below, such as a steering rate; inf for none
    in_zones       (n+1,)         largest ds/dt by speed zones; inf for none
    middle         (n,)           states in the middles of the intervals
    rows           (r, c)         combinations rows @ q of the coordinates that have limits
    speeds         (r,)           their largest speeds
    accelerations  (r,)           their largest accelerations
    """

    kinds: tuple[str, ...]
    steps: FloatArray
    states: States
    slopes: FloatArray
    bends: FloatArray
    pace: FloatArray
    most: FloatArray
    in_zones: FloatArray
    middle: States
    rows: FloatArray
    speeds: FloatArray
    accelerations: FloatArray

    @property
    def in_middle(self) -> tuple[FloatArray, FloatArray]:
        """Slopes and bends (n, c) in the middles of the intervals."""
        turn = np.diff(self.bends, axis=0)[0] * self.steps[:, None] / 8.0
        return 0.5 * (self.slopes[1:] + self.slopes[:-1]) - turn, 0.5 * self.bends.sum(axis=0)

    def followed_by(self, other: PathStretch) -> PathStretch:
        """Return both stretches as one; the other one must begin at the end of this one, in its direction."""
        names = self.states.names
        joined = {n: np.concatenate([getattr(self.states, n), getattr(other.states, n)[1:]]) for n in names}
        middle = {n: np.concatenate([getattr(self.middle, n), getattr(other.middle, n)]) for n in names}
        steps = np.concatenate([self.steps, other.steps])
        slopes = np.concatenate([self.slopes, other.slopes[1:]])
        bends = np.concatenate([self.bends, other.bends], axis=1)
        limits = (self.rows, self.speeds, self.accelerations)
        pace = np.concatenate([self.pace, other.pace[1:]])
        pace[self.steps.size] = 0.5 * (pace[self.steps.size - 1] + pace[self.steps.size + 1])
        most, zoned = (
            np.concatenate([own[:-1], [min(own[-1], its[0])], its[1:]])
            for own, its in ((self.most, other.most), (self.in_zones, other.in_zones))
        )
        kinds = self.kinds + other.kinds
        return PathStretch(kinds, steps, States(**joined), slopes, bends, pace, most, zoned, States(**middle), *limits)

    def continues(self, before: PathStretch) -> bool:
        """Return whether the robot need not stand between stretch ``before`` and this one.

        This holds if both are straight and have the same direction.
        """
        if before.kinds[-1] != self.kinds[0] or before.bends.any() or self.bends.any():
            return False
        return float(np.abs(before.slopes[-1] - self.slopes[0]).max()) < PARALLEL * float(np.abs(self.slopes[0]).max())


def stretches_of(
    run: Trajectory, coordinates: Coordinates, zones: ZoneLimits | None = None
) -> list[PathStretch | float]:
    """Return, in order of time, the stretches of an executed trajectory and, as floats, the seconds of its holds.

    coordinates  coordinates of the robot, by which standstills are found and lengths are measured
    zones        limits of speed zones, whose borders become grid positions; None for none

    If ``coordinates.joins``, stretches in one straight direction without a hold between them become one: for example,
    reaches of an arm.
    """
    parts: list[PathStretch | float] = []
    motions: list[int] = []
    lasts = run.durations
    for i, kind in enumerate(run.kinds):
        if lasts[i] <= 0.0:
            continue
        if kind == HOLD.kind:
            parts.append(float(lasts[i]))
            continue
        motions.append(i)
        if i + 1 < len(run) and not _stands(run, run.times[i + 1], coordinates) and run.kinds[i + 1] != HOLD.kind:
            continue
        stretch = _stretch(run, motions, coordinates, zones)
        motions = []
        before = parts[-1] if parts else None
        if coordinates.joins and isinstance(before, PathStretch) and stretch.continues(before):
            parts[-1] = before.followed_by(stretch)
        else:
            parts.append(stretch)
    return parts


def _stands(run: Trajectory, t: float, coordinates: Coordinates) -> bool:
    """Return whether the robot stands at time t, s."""
    return bool(np.abs(coordinates.rates(run.at(t), run.rates(t)[0]) / coordinates.unit).max() < REST)


def _stretch(
    run: Trajectory, motions: Sequence[int], coordinates: Coordinates, zones: ZoneLimits | None
) -> PathStretch:
    """Return the stretch of some motions, on a grid with the borders of all their phases and of speed zones."""
    times, kinds = _grid(run, motions, coordinates)
    limits = np.full(len(kinds), np.inf)
    if zones is not None:
        phases = times
        times, limits = zones.on_grid(phases)
        kinds = tuple(kinds[i] for i in (np.searchsorted(phases, times[:-1], side="right") - 1).tolist())
    middles = 0.5 * (times[1:] + times[:-1])
    states, middle = run.at(times), run.at(middles)
    rates, between = (
        coordinates.rates(s, run.rates(t)[0]) / coordinates.unit for s, t in ((states, times), (middle, middles))
    )
    rates[[0, -1]] = 0.0  # at the end, `rates` are those of the next motion
    unknown = np.flatnonzero(~rates.any(axis=1))[1:-1]  # in a phase of no duration, between speed-up and slow-down
    if unknown.size:
        before = times[unknown] - BEFORE * np.diff(times)[unknown - 1]
        rates[unknown] = coordinates.rates(run.at(before), run.rates(before)[0]) / coordinates.unit
    pace, within = np.linalg.norm(rates, axis=1), np.linalg.norm(between, axis=1)
    steps = np.diff(times) * (pace[:-1] + 4.0 * within + pace[1:]) / 6.0  # Simpson's rule
    if (steps <= 0.0).any() or (pace[1:-1] < REST).any():
        raise OptionError(
            f"the robot stands somewhere within motions {motions[0]} to {motions[-1]} of the trajectory, so its path "
            "has no direction there; split the motion at that place"
        )
    half = np.diff(times) * (5.0 * pace[:-1] + 8.0 * within - pace[1:]) / 24.0 / steps  # share of a step at its middle
    slopes, halfway = np.zeros_like(rates), between / within[:, None]
    slopes[1:-1] = rates[1:-1] / pace[1:-1, None]
    slopes[0] = halfway[0] - (slopes[1] - halfway[0]) * half[0] / (1.0 - half[0])  # at rest: linear
    slopes[-1] = halfway[-1] + (halfway[-1] - slopes[-2]) * (1.0 - half[-1]) / half[-1]
    if np.abs(slopes - slopes[1]).max() < STRAIGHT:
        slopes[:] = slopes[1]
        bends = np.zeros((2, steps.size, slopes.shape[1]))
    else:  # of the quadratic through both ends and the middle
        first = (halfway - slopes[:-1]) / (half * steps)[:, None]
        last = (slopes[1:] - halfway) / ((1.0 - half) * steps)[:, None]
        third = (last - first) / steps[:, None]
        bends = np.stack([first - third * (half * steps)[:, None], last + third * ((1.0 - half) * steps)[:, None]])
    unit = coordinates.unit
    slopes, bends = slopes * unit, bends * unit
    faster = within * coordinates.quickening(middle, *run.rates(middles))
    most, zoned = np.minimum(np.append(faster, np.inf), np.append(np.inf, faster)), np.full(times.size, np.inf)
    if np.isfinite(limits).any():
        zoned = paces(limits, coordinates.rates_of_states(states, slopes, 0.0 * slopes)[0])
    return PathStretch(kinds, steps, states, slopes, bends, pace, most, zoned, middle, *coordinates.limits(slopes))


def _grid(run: Trajectory, motions: Sequence[int], coordinates: Coordinates) -> tuple[FloatArray, tuple[str, ...]]:
    """Return times (n+1,), s, that cut each phase of some motions (given by index) evenly, and the kinds of intervals.

    The times become grid positions; the kinds (n,) are those of laws that drive the intervals at any speed profile.
    """
    laws = laws_of(run.model)
    first, fewest = laws[run.kinds[motions[0]]], FEWEST
    if is_curve(first):
        fewest = max(FEWEST, CURVED // len(motions)) if CLOCK in first.extra else FEW
    pieces, kinds = [run.times[motions[0] : motions[0] + 1]], list[str]()
    for i in motions:
        start, end = run.states.take([i]), run.states.take([i + 1])
        begin = float(run.times[i])
        for phase in laws[run.kinds[i]].phases(start, end):
            lasts = float(np.ravel(phase.duration)[0])
            if lasts > REST * run.durations[i]:
                count = int(np.clip(np.ceil(lasts / INTERVAL), fewest, MOST))
                pieces.append(begin + lasts * np.arange(1, count + 1) / count)
                kinds += [coordinates.kind(run.kinds[i])] * count
                begin += lasts
        pieces[-1][-1] = run.times[i + 1]
    return np.concatenate(pieces), tuple(kinds)


INSIDE = 1e-9  # share of a zone above which its limit holds
SAMPLES = 1_000_000  # largest number of positions at which a stretch is looked at
HALVINGS = 40  # of the time between two positions, until the border of a zone is found
NEAR = 1e-3  # share of an interval: a border that is nearer to its end is no grid position


@dataclass(frozen=True, eq=False)
class ZoneLimits:
    """Largest speeds that the speed zones of a world allow along a trajectory.

    A limit holds wherever the criterion "speeding" counts it: while the base's axis is in the zone, and up to two or
    three cells of the distance grid beyond its border.

    run    the trajectory, of a robot whose states have x and y
    zones  limits, m/s, each with a field that is above 0 where the limit holds
    """

    run: Trajectory
    zones: tuple[tuple[float, Field], ...]

    @classmethod
    def of(cls, world: World, run: Trajectory) -> ZoneLimits:
        """Return the limits of a world's speed zones along a trajectory; none for a robot without a base."""
        moves = {"x", "y"} <= {*run.model.space.names} and any(zone.kind == "speed" for zone in world.content.zones)
        return cls(run, speed_limits(world) if moves else ())

    def at(self, times: FloatArray) -> FloatArray:
        """Return the largest allowed speed (N,), m/s, at times, s; inf where no limit holds."""
        states, least = self.run.at(times), np.full(times.size, np.inf)
        for limit, inside in self.zones:
            least = np.where(inside(states.x, states.y) > INSIDE, np.minimum(least, limit), least)
        return least

    def on_grid(self, times: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the grid (n+1,) of times, s, with the borders of zones added, and the limit (n,) of each interval.

        A border close to a grid position is left out; the whole interval then has the lower limit.
        """
        if not self.zones:
            return times, np.full(times.size - 1, np.inf)
        step = 0.5 * min(inside.spacing for _, inside in self.zones)
        states = self.run.at(times)
        chords = np.hypot(np.diff(states.x), np.diff(states.y))
        counts = np.clip(np.ceil(2.0 * chords / step), 2, max(2, SAMPLES // chords.size)).astype(int)
        share = np.arange(counts.sum()) - np.repeat(np.cumsum(counts) - counts, counts)
        dense = np.append(np.repeat(times[:-1], counts) + share * np.repeat(np.diff(times) / counts, counts), times[-1])
        allowed = self.at(dense)
        (changes,) = (allowed[1:] != allowed[:-1]).nonzero()
        low, high = dense[changes], dense[changes + 1]
        for _ in range(HALVINGS if changes.size else 0):
            middle = 0.5 * (low + high)
            before = self.at(middle) == allowed[changes]
            low, high = np.where(before, middle, low), np.where(before, high, middle)
        added = times.tolist()
        for border, here in zip(high.tolist(), np.searchsorted(times, high).tolist(), strict=True):
            slack = NEAR * float(times[here] - times[here - 1])
            if all(abs(border - other) > slack for other in (added[-1], times[here - 1], times[here])):
                added.append(border)
        grid = np.unique(added)
        owner = np.clip(np.searchsorted(grid, dense, side="right") - 1, 0, grid.size - 2)
        limits = np.full(grid.size - 1, np.inf)
        inner = dense != grid[owner]  # a grid position may be on a border
        np.minimum.at(limits, owner[inner], allowed[inner])
        return grid, np.minimum(limits, self.at(0.5 * (grid[1:] + grid[:-1])))


def paces(limits: FloatArray, slopes: States) -> FloatArray:
    """Return the largest ds/dt (n+1,) at grid positions of the path coordinate s, from the limits (n,) between them.

    slopes  derivatives of the states by s at the grid positions
    """
    allowed = np.minimum(np.append(limits, np.inf), np.append(np.inf, limits))
    rate = np.broadcast_to(np.hypot(slopes.x, slopes.y), allowed.shape)
    return np.asarray(np.where(rate > 0.0, allowed / np.where(rate > 0.0, rate, 1.0), np.inf))
